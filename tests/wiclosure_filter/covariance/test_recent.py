"""What was used last stays, as far as it fits."""

from __future__ import annotations

from wiclosure.wiclosure_filter.covariance.recent import Recent


def test_what_was_used_last_stays_as_far_as_it_fits() -> None:
    recent: Recent[str] = Recent(10)
    computed = []

    def asked(key: str, size: int) -> str:
        def compute() -> tuple[str, int]:
            computed.append(key)
            return key.upper(), size

        return recent.reuse(key, compute)

    assert [asked(key, 4) for key in "abacaeba"] == list("ABACAEBA")
    assert computed == list("abceba")
    assert asked("d", 40) == asked("d", 40) == "D"  # more than fits, and needed now
    assert asked("a", 4) == "A"
    assert computed == list("abcebada")
