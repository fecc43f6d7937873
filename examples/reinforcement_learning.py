"""A policy learned by PPO drives a lane change, beside a law of pure pursuit with feed-forward.

pip install -e ".[gym]" stable-baselines3 && python examples/reinforcement_learning.py 400000

Install torch for the CPU first, as its own site says.
"""

import sys

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from sim_bridge import CarEnv

SCENARIO = "lane_change_60"


def pursue(seen):
    vx, vy, _, ey, epsi, wanted, wanted_mps2, _, k0, k1, *_ = seen
    ahead_m = max(0.8 * vx, 4.0)
    per_m = 0.5 * (k0 + k1) - 2.0 * (epsi + vy / vx) / ahead_m - ey / ahead_m**2
    lateral_share = vx**2 * per_m / 7.0
    return np.array([0.1 + (wanted_mps2 + 1.5 * (wanted - vx)) / 4.5, lateral_share])


def drive(act):
    env, is_over = CarEnv(SCENARIO), False
    seen, _ = env.reset()
    while not is_over:
        seen, _, is_lost, is_over, info = env.step(act(seen))
        is_over = is_over or is_lost
    return f"{info['ey_rms_m']:.3f} m RMS, peak {info['ey_peak_m']:.3f} m in {info['time_s']:.1f} s"


envs = VecNormalize(make_vec_env(lambda: CarEnv(SCENARIO, start_ey_m=0.3), 8, seed=1), gamma=0.98)
policy = {"log_std_init": -2.0}
ppo = PPO("MlpPolicy", envs, n_steps=512, batch_size=256, gamma=0.98, policy_kwargs=policy, seed=1)
ppo.learn(int(sys.argv[1]))
envs.training = False
print("PPO     ", drive(lambda seen: ppo.predict(envs.normalize_obs(seen), deterministic=True)[0]))
print("pursuit ", drive(pursue))
