"""A model from your own matrices: a linear single-track car at 80 km/h, as a bundle that drives.

pip install -e . && python examples/linear_model.py
"""

import numpy as np
from scipy.linalg import expm

from rt_controller import Bundle, simulate

V, DT, M, JZ, LF, LR, CF, CR, RATIO = 22.2, 0.025, 1530.0, 2300.0, 1.2, 1.5, 9e4, 1.1e5, 16.0
# Rows and columns: v_x, v_y, yaw rate, progress in one period, e_y, e_psi; then the inputs
# throttle, brake, steering wheel; the road's curvature; and the constant 1.
F = np.zeros((11, 11))
F[0, :8] = [-0.02, 0, 0, 0, 0, 0, 4.0, -0.02]
F[0, 10] = 0.02 * V - 0.7
F[1, 1:3] = [-(CF + CR) / (M * V), -(LF * CF - LR * CR) / (M * V) - V]
F[2, 1:3] = [-(LF * CF - LR * CR) / (JZ * V), -(LF**2 * CF + LR**2 * CR) / (JZ * V)]
F[1:3, 8] = [CF / (M * RATIO), LF * CF / (JZ * RATIO)]
F[4, [1, 5]], F[5, [2, 9]] = [1, V], [1, -V]
D = expm(DT * F)[:6]
D[3] = DT * np.eye(11)[0]  # progress is v_x over one period
bundle = Bundle.linear(D[:, :6], D[:, 6:9], D[:, 9:10], offset=D[:, 10], name="single-track")
bundle.save("single-track-bundle")  # offline-export --bundle single-track-bundle stores its plans
print(simulate("double_lane_change", model=bundle).errors)
