"""A finished drive: its table, the recorder in memory that makes it, its scenario and figures."""
