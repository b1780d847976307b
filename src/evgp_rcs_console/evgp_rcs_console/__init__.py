"""The officials' console of the EVGP race control: a window and a terminal client."""
