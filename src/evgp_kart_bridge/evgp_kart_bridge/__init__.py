"""The kart's side of the EVGP race control: gives the autonomy stack the race state to obey."""
