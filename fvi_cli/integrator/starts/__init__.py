"""Powers of time with which a motion begins, and corrections of the first steps."""
