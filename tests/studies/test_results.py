"""The description of the results names what the program writes."""

from pathlib import Path

from studies.foundation import Parameters
from studies.foundation_run import carry_out, set_up

TEXT = (Path(__file__).resolve().parent.parent.parent / "docs/results.md").read_text(encoding="utf-8")


def test_every_key_of_the_summary_is_described():
    p = Parameters(radius=0.2, displacement=0.001, method="fem")
    done = carry_out(set_up(p), figures=False, progress=False)
    assert [key for key in done.summary if f"`{key}`" not in TEXT] == []


def test_files_and_keys_of_the_comparison_are_described():
    from studies import foundation_compare

    table = [name for name in foundation_compare.FILES if name.startswith("comparison")]
    assert table and all(
        f"`comparison{Path(name).suffix}`" in TEXT or f"`{Path(name).suffix}`" in TEXT for name in table
    )
    for key in ("rows", "stepping_seconds", "speed_up", "quantity", "difference", "published_difference"):
        assert f"`{key}`" in TEXT
