"""The EVGP race control: rules, kart server, record and node for the officials."""
