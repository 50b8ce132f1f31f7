"""Contact laws, one file a law: constants for the user, the kernel of a contact for the loops."""

from particles.laws.li_chu import LiChu

__all__ = ["LiChu"]
