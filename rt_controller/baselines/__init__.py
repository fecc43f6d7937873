"""Controllers that need no learned model, for comparison, and the car that they know."""
