"""A dictionary model of the motion of a car; the path follows by kinematics."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.dictionary.model import LiftedModel
from offline.baselines.dictionary.search import EdmdSettings, fit_edmd
from offline.baselines.road_path import Learned, path_states, split_path
from offline.data.dataset import Dataset
from offline.data.signals import past_names
from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import Schema
from rt_controller.report.table import Fact


@dataclass(frozen=True, slots=True)
class MotionModel:
    """A model of v_x, v_y and yaw rate, completed by the path."""

    motion: LiftedModel
    learned: Learned
    past: tuple[int, ...]
    """columns of the past that the model of the motion reads"""
    dt_s: float

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`."""
        n, exogenous, curvature = self.learned
        motion = self.motion.predict(x0[:, :n], past[..., self.past], U, W[..., exogenous])
        path = path_states(np, motion, x0, W[..., curvature], self.dt_s)
        states = np.concatenate([motion, np.repeat(x0[:, None, n:], motion.shape[1], axis=1)], -1)
        states[:, 1:, n:] = path
        return states

    def fit_info(self) -> tuple[Fact, ...]:
        """What the fit of the motion chose."""
        return (*self.motion.fit_info(), Fact("path", "integrated"))


def edmd_with_path(settings: EdmdSettings) -> Baseline:
    """The baseline with these settings; for data without a path it is the plain one."""
    return Baseline(fit=partial(fit_motion, settings=settings))


def fit_motion(dataset: Dataset, settings: EdmdSettings) -> MotionModel | LiftedModel:
    """The dictionary model of the motion with the smallest validation score of the motion."""
    learned = split_path(dataset.schema)
    if learned.curvature is None:
        return fit_edmd(dataset, settings)
    part = motion_part(dataset, learned)
    names = past_names(part.schema, part.roles)
    all_names = past_names(dataset.schema, dataset.roles)
    past = tuple(all_names.index(name) for name in names)
    return MotionModel(fit_edmd(part, settings), learned, past, dataset.schema.dt_s)


def motion_part(dataset: Dataset, learned: Learned) -> Dataset:
    """The same drives without path states, curvature and roads."""
    n, exogenous, _ = learned
    schema, recording = dataset.schema, dataset.recording
    schema = Schema(
        schema.states[:n],
        schema.inputs,
        tuple(schema.exogenous[i] for i in exogenous),
        schema.dt_s,
    )
    left = {*schema.state_names, *schema.input_names, *schema.exogenous_names}
    roles, manifest = dataset.roles, dataset.manifest
    roles = replace(
        roles,
        centred=tuple(name for name in roles.centred if name in left),
        odd=roles.odd and tuple(name for name in roles.odd if name in left),
        past=tuple(name for name in roles.past if name in left),
    )
    return replace(
        dataset,
        recording=recording._replace(
            x=recording.x[:, :n], w=recording.w[:, list(exogenous)], pose=np.zeros((0, 3))
        ),
        slices=dataset.slices._replace(anchor=None),
        manifest=replace(manifest, schema=schema, roles=roles, roads=None),
    )
