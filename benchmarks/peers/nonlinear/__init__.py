"""The same task given to controllers with a nonlinear model: what a linear one is for."""
