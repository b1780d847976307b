"""The kart's side of the EVGP race control: tells the stack the state to obey."""
