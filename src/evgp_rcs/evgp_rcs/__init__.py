"""The EVGP race control: race rules, kart server, record and the node for the officials."""
