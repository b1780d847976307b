"""
The parts of a race, for tests and the demonstration: all real, none a mock.

A team can put this folder on its ``pythonpath`` and use the fixtures of
``race_parts.fixtures`` in its own tests: ``pytest_plugins = ['race_parts.fixtures']``.
Each part owns its process or its context, executor and domain, and gives everything back
in ``close``; each can be used in a ``with`` statement.
"""
