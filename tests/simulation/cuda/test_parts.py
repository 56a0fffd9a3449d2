"""Parts of the nodes: a node's sum over groups is that over its particles."""

import numpy as np

from physreal_core.simulation.cuda.parts import LARGEST_GROUP, WARP, Parts, threads_of
from physreal_core.simulation.lattice import base_nodes, lattice_of
from tests.simulation.scenes import block


def test_every_particle_gives_to_its_27_nodes_once():
    """Of an uneven body, whose cells hold one to eight particles."""
    body = block((5, 7, 9))
    lattice = lattice_of(body, ())
    lowest = base_nodes(body.x0, lattice)[lattice.order(body.x0)]
    parts, value = Parts.of(lowest, lattice), np.random.default_rng(0).integers(1, 1000, (len(lowest), 27))
    around = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(27, 3)
    expected = np.zeros(lattice.nodes, dtype=np.int64)
    np.add.at(expected, np.ravel_multi_index(np.moveaxis(lowest[:, None] + around, -1, 0), lattice.count), value)
    left = np.zeros((parts.groups, 27), dtype=np.int64)
    np.add.at(left, parts.group, value)
    taken = left[parts.of_nodes, parts.which]
    found = [taken[begin:end].sum() for begin, end in zip(parts.begin[:-1], parts.begin[1:], strict=True)]
    np.testing.assert_array_equal(found, expected)


def test_a_group_lies_in_one_warp_and_follows_its_head():
    body = block((5, 7, 9))
    lattice = lattice_of(body, ())
    parts = Parts.of(base_nodes(body.x0, lattice)[lattice.order(body.x0)], lattice)
    for group in range(parts.groups):
        members = np.flatnonzero(parts.group == group)
        assert len(members) <= LARGEST_GROUP
        assert members[-1] - members[0] + 1 == len(members)
        assert members[0] // WARP == members[-1] // WARP
        np.testing.assert_array_equal(parts.following[members], np.arange(len(members))[::-1])
    assert threads_of(315) == 320
