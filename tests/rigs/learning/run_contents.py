"""What a run folder contains: the lines of its history, and weights."""

import json

import torch


def history(run):
    return [json.loads(line) for line in run.history.read_text().splitlines()]


def weights_equal(one, other) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)
