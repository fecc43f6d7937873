"""The controller's quadratic programs through other solvers, and other controllers."""
