"""Which observables may depend on which, with the path in any columns."""

import pytest
import torch

from offline.config import PRESETS
from offline.model.observables import Observables, PathColumns, observables_of, path_columns
from rt_controller.contract.signals import VEHICLE, Schema, Signal

PATH = PathColumns(ds=3, ey=4, epsi=5)
CAR = Observables(6, PATH, 3, 2, has_constant=True)
"""12: three states of the motion, three of the path, 3 + 2 latents, the constant"""
ONE_BLOCK = Observables(4, None, 3, 0, has_constant=True)


def test_the_path_is_found_by_its_names() -> None:
    assert path_columns(VEHICLE) == PATH
    turned = Schema(VEHICLE.states[::-1], VEHICLE.inputs, VEHICLE.exogenous, VEHICLE.dt_s)
    assert path_columns(turned) == PathColumns(ds=2, ey=1, epsi=0)
    planar = Schema((Signal("vx_mps", "m/s"), Signal("ey_m", "m")), (), (), 0.1)
    assert path_columns(planar) is None


def test_latents_are_divided_between_motion_and_path() -> None:
    config = PRESETS["recommended"]
    assert observables_of(config, 6, PATH) == Observables(6, PATH, 39, 20, True)
    assert observables_of(config, 6, PATH).n == 6 + config.latents
    assert observables_of(config, 4, None) == Observables(4, None, 59, 0, True)
    together = config.model_copy(update={"separate_motion": False})
    assert observables_of(together, 6, PATH) == Observables(6, None, 59, 0, True)


@pytest.mark.parametrize(("latents", "of_motion", "of_path"), [(10, 5, 4), (4, 2, 1), (1, 0, 0)])
def test_of_few_latents_at_most_half_describe_the_path(
    latents: int, of_motion: int, of_path: int
) -> None:
    config = PRESETS["recommended"].model_copy(update={"latents": latents})
    found = observables_of(config, 6, PATH)
    assert (found.motion_latents, found.path_latents) == (of_motion, of_path)


def test_motion_is_what_does_not_depend_on_the_road() -> None:
    expected = [True] * 3 + [False] * 3 + [True] * 3 + [False] * 2 + [True]
    assert CAR.is_motion.tolist() == expected
    assert CAR.is_gain_of_path.tolist() == [True] * 3 + [False] * 3 + [True] * 6
    assert ONE_BLOCK.is_motion.all()


@pytest.mark.parametrize("path", [PATH, PathColumns(0, 1, 2), PathColumns(5, 0, 3)])
def test_the_coupling_is_that_of_a_car_on_a_road(path: PathColumns) -> None:
    known = CAR._replace(path=path)
    learned, one = known.coupling()
    motion, on_road = known.is_motion, known.is_gain_of_path
    for row in range(known.n):
        if motion[row]:
            assert learned[row].tolist() == motion.tolist()
        elif row == path.ey:
            expected = on_road.clone()
            expected[path.epsi] = True
            assert learned[row].tolist() == expected.tolist()
        else:
            assert learned[row].tolist() == on_road.tolist()
    assert one.nonzero().tolist() == sorted([[path.ey, path.ey], [path.epsi, path.epsi]])
    assert not (learned & one).any()


def test_nothing_depends_on_progress_or_lateral_error() -> None:
    learned, _ = CAR.coupling()
    assert not learned[:, [PATH.ds, PATH.ey]].any()
    assert learned[:, PATH.epsi].nonzero().flatten().tolist() == [PATH.ey]


def test_without_a_path_everything_may_depend_on_everything() -> None:
    learned, one = ONE_BLOCK.coupling()
    assert learned.all()
    assert not one.any()


def test_the_blocks_are_those_whose_eigenvalues_are_those_of_a() -> None:
    """With the integrators and the constant, which have the eigenvalue 1; progress has 0."""
    torch.manual_seed(0)
    learned, one = CAR.coupling()
    A = torch.randn(12, 12).double() * learned + one
    A[-1] = torch.eye(12)[-1]
    blocks = CAR.blocks()
    assert [block.tolist() for block in blocks] == [[0, 1, 2, 6, 7, 8], [9, 10]]
    of_blocks = [torch.linalg.eigvals(A[block][:, block]) for block in blocks]
    known = torch.tensor([0.0, 1.0, 1.0, 1.0], dtype=torch.complex128)
    expected = torch.cat([*of_blocks, known])
    found = torch.linalg.eigvals(A)
    assert (found[:, None] - expected[None, :]).abs().min(dim=1).values.max() < 1e-6
    assert (found[:, None] - expected[None, :]).abs().min(dim=0).values.max() < 1e-6


def test_one_block_has_all_but_the_constant() -> None:
    assert [block.tolist() for block in ONE_BLOCK.blocks()] == [list(range(7))]
    without = ONE_BLOCK._replace(has_constant=False)
    assert [block.tolist() for block in without.blocks()] == [list(range(7))]


def test_no_latents_of_the_path_are_no_block() -> None:
    assert len(CAR._replace(path_latents=0).blocks()) == 1
