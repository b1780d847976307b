"""Is this kart, or this race control, fit to race? Clauses, checks, verdicts, a report; no ROS."""

VERSION = '0.1.0'
"""The version of the inspection, as in package.xml; every report names it."""
