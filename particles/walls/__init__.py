"""Rigid walls and tools: shapes, motion, contact, lists."""

from particles.walls import shapes
from particles.walls.history import WallHistory
from particles.walls.motion import Free, Servo
from particles.walls.wall import Plate, Wall, room

__all__ = ["Free", "Plate", "Servo", "Wall", "WallHistory", "room", "shapes"]
