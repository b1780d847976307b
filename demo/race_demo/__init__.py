"""
The demonstration: a race from the garage to the garage, and one with an incident.

``paddock`` starts and ends all parts, ``races`` drives the two races as officials do,
``record`` is what was heard of a race, ``checks`` judges that, ``screen`` shows it.
"""
