"""A soak of race control: many karts, faults, acks and commands, judged on the wire."""
