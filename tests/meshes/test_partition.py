"""Cells shared out by what they cost."""

import numpy as np
import pytest

from meshes import partition


def squares(wide, high):
    """Corners of unit squares, numbered along y first."""
    corner = np.stack(np.meshgrid(np.arange(wide), np.arange(high), indexing="ij"), axis=-1).reshape(-1, 1, 2)
    return corner + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


def under_a_plate(corners):
    """A thousand particles in each of 6 x 3 cells at the top."""
    x, y = corners.mean(axis=1).T
    return np.where((np.abs(x - 9.0) < 3.0) & (y > 6.0), 1000.0, 1.0)


@pytest.mark.parametrize("ranks, largest", [(2, 9), (3, 6), (4, 5), (5, 4), (7, 3), (18, 1)])
def test_heavy_cells_are_shared_as_evenly_as_whole_cells_can_be(ranks, largest):
    corners = squares(18, 9)
    owner = partition.ranks_of(corners, under_a_plate, ranks)
    heavy = np.bincount(owner[under_a_plate(corners) > 1.0], minlength=ranks)
    assert heavy.max() == largest and heavy.sum() == 18


def test_neighbours_across_facets_know_each_cell():
    """Of four squares, one a rank, each is known by its owner first and by the two that share a side with it."""
    found = partition.destinations(squares(2, 2), lambda corners: np.ones(len(corners)), 4)
    of_cells = [found.ranks[a:b].tolist() for a, b in zip(found.start[:-1], found.start[1:])]
    owner = [one[0] for one in of_cells]
    assert sorted(owner) == [0, 1, 2, 3]
    for cell, across in enumerate([(1, 2), (0, 3), (0, 3), (1, 2)]):
        assert sorted(of_cells[cell][1:]) == sorted(owner[other] for other in across)


def test_more_ranks_than_cells_leave_some_without():
    assert len(set(partition.ranks_of(squares(2, 1), lambda corners: np.ones(len(corners)), 5).tolist())) == 2


def test_costs_must_be_numbers_one_a_cell():
    with pytest.raises(ValueError, match="for each of 2 cells"):
        partition.ranks_of(squares(2, 1), lambda corners: np.ones(3), 2)
    with pytest.raises(ValueError, match="zero or positive"):
        partition.ranks_of(squares(2, 1), lambda corners: -np.ones(2), 2)
