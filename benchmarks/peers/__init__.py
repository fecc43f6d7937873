"""The same quadratic programs for everybody who can solve them."""
