"""How long tests wait."""

PATIENCE = 30.0
"""How long anything is awaited before a test gives up, seconds: far more than it ever takes."""
