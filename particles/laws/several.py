"""The contact laws of a scene by pair of material ids, as the loops want them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from particles.laws.touch import numbers_of


class Laws:
    """All laws of a scene, compiled to one template of constants and, where there are several, a table of numbers.

    Args:
        law: a law, or a mapping {(a, b): law} for all pairs of material ids a <= b that occur.
        materials: ids 0, 1, ... (n,), or None.
        count: number of particles.
        space: spheres, not discs.

    Raises:
        ValueError: a pair of materials without a law, laws that do not go together, ids that make no sense.
    """

    def __init__(self, law: Any, materials: Any, count: int, space: bool) -> None:
        if hasattr(law, "constants"):
            self.pairs = {(0, 0): law}
        elif isinstance(law, Mapping) and law and all(hasattr(one, "constants") for one in law.values()):
            self.pairs = {(min(pair), max(pair)): one for pair, one in law.items()}
        else:
            raise ValueError("law must be a contact law (such as LiChu) or a mapping {(material, material): law}")
        if len({type(one) for one in self.pairs.values()}) > 1:
            raise ValueError("the laws of an assembly must be of one kind; take constants of zero for what a pair lacks")
        self.space = space
        self.several = len(self.pairs) > 1
        self.all: list[Any] = list(self.pairs.values())
        first = self.all[0]
        self.template = first.constants(self.all, space)
        self.columns: list[tuple[str, float]] = first.columns(self.all, space)
        self.has_bonds = bool(self.columns) and self.columns[0][0] == "bond"
        self.signs = np.array([sign for _, sign in self.columns])
        self.massive = 1 if any(getattr(one, "needs_mass", bool)() for one in self.all) else None
        self.viscous = 1 if any(one.is_viscous() for one in self.all) else None
        self.materials: np.ndarray | None = None
        self.kinds = 1
        self.table: np.ndarray | None = None
        self.of_pair = np.zeros((1, 1), dtype=np.int64)  # place in `all`, by material ids
        if self.several or materials is not None:
            self._set_table(materials, count)

    def _set_table(self, materials: Any, count: int) -> None:
        ids = np.zeros(count, dtype=np.int32) if materials is None else np.array(materials)
        if ids.shape != (count,) or ids.dtype.kind not in "iu" or (ids < 0).any():
            raise ValueError(f"materials must be {count} ids from 0 upwards, one for each particle")
        kinds = 1 + max(max(max(pair) for pair in self.pairs), int(ids.max(initial=0)))
        places = {pair: k for k, pair in enumerate(self.pairs)}
        of_pair = np.zeros((kinds, kinds), dtype=np.int64)
        present = np.unique(ids)
        for a in present:
            for b in present[present >= a]:
                if (a, b) not in self.pairs:
                    raise ValueError(f"law has no entry for materials ({a}, {b})")
                of_pair[a, b] = of_pair[b, a] = places[a, b]
        if self.several:
            self.materials, self.kinds, self.of_pair = ids.astype(np.int32), kinds, of_pair
            self.table = np.ascontiguousarray(self.rows(self.all)[of_pair])

    def rows(self, laws: list[Any]) -> np.ndarray:
        """Numbers of laws (k, numbers) in the places of the template.

        Raises:
            ValueError: a law has something that no law of the particles has.
        """
        found = []
        for law in laws:
            if type(law) is not type(self.all[0]):
                raise ValueError(f"law={law!r} must be of the kind of the particles' law, {type(self.all[0]).__name__}")
            own = law.constants([*self.all, law], self.space)
            if len(numbers_of(own)) != len(numbers_of(self.template)):
                raise ValueError(
                    "law of a plate has a channel or dashpot that no law of the particles has; add a small one there"
                )
            found.append(numbers_of(law.constants(self.all, self.space)))
        return np.array(found)

    @property
    def blank(self) -> tuple[float, ...]:
        """History of a new contact."""
        return (0.0,) * len(self.columns)

    def by_channel(self, history: np.ndarray) -> dict[str, np.ndarray]:
        """Histories (columns, k) as arrays (k, components) by channel."""
        names = [name for name, _ in self.columns]
        return {name: history[[k for k, one in enumerate(names) if one == name]].T for name in dict.fromkeys(names)}
