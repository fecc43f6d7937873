"""Other people's solvers behind the controller's protocol: one file each."""
