"""Controllers with a nonlinear vehicle model, on the same task as the linear and bilinear ones."""
