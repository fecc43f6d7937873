"""What a longer horizon or a larger model costs, with the states in the QP and without."""
