"""The model bundle: its parts, its files, its checks, and prediction with it."""
