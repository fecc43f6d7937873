"""Measurements that need more than the project itself: other solvers, whole drives."""
