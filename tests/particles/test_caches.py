"""Compiled code on disk goes when any source is younger."""

import os

from particles.caches import drop_stale


def test_indexes_older_than_any_source_are_removed(tmp_path):
    cache = tmp_path / "__pycache__"
    cache.mkdir()
    old, new, source = cache / "a.nbi", cache / "b.nbi", tmp_path / "law.py"
    for path, time in ((old, 1000), (source, 2000), (new, 3000)):
        path.write_text("")
        os.utime(path, (time, time))
    drop_stale(tmp_path)
    assert not old.exists() and new.exists()
    other = tmp_path.parent / f"{tmp_path.name}-other"
    other.mkdir()
    (other / "kernel.py").write_text("")
    drop_stale(tmp_path, other)
    assert not new.exists()
