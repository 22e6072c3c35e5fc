"""Changes to files as bad disks, editors, converters and attackers make them; each follows from its seed."""

from __future__ import annotations

import re

import numpy as np

NUMBERS = [
    "nan", "inf", "-inf", "1e308", "-1e200", "1e-320", "1e999999999", "-1e-999999999999", "0", "-0", "-1", "1,5", "1_0",
    "18446744073709551615", "-9223372036854775809", "9" * 40, "9" * 5000, "0x1f", "1e5000", "07", "true", "null",
]  # fmt: skip
WORDS = [
    *NUMBERS,
    "",
    "x",
    "#",
    '"',
    "'",
    "\\",
    "\0",
    "\ufeff",
    "\ud7ff",
    "é",
    "🤖",
    "../../etc/passwd",
    "-",
    "~",
    "a" * 300,
]
STRUCTURES = [
    "[",
    "]",
    "{",
    "}",
    "[" * 200,
    "{a: " * 100,
    "&a [*a]",
    "*a",
    "!!python/name:os.system",
    "!!int x",
    ": ",
    "\t",
]


def mutated(content: bytes, rng: np.random.Generator, *, is_text: bool) -> bytes:
    """One to five changes."""
    for _ in range(int(rng.integers(1, 6))):
        change = _text if is_text and rng.random() < 0.75 else _bytes
        content = change(content, rng)
    return content


def _text(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.decode("utf-8", errors="surrogateescape").split("\n")
    n, m = (int(i) for i in rng.integers(0, len(lines), 2))
    spans = [match.span() for match in re.finditer(r"[^\s,:\[\]{}\"]+", lines[n])] or [(0, 0)]
    start, end = spans[int(rng.integers(0, len(spans)))]
    match int(rng.integers(0, 10)):
        case 0 | 1:
            lines[n] = lines[n][:start] + str(rng.choice(NUMBERS)) + lines[n][end:]
        case 2:
            lines[n] = lines[n][:start] + str(rng.choice(WORDS)) + lines[n][end:]
        case 3:
            lines[n] = lines[n][:start] + _other_digits(lines[n][start:end], rng) + lines[n][end:]
        case 4:
            lines[n], lines[m] = lines[m], lines[n]
        case 5:
            lines[n] = lines[n][: int(rng.integers(0, len(lines[n]) + 1))]
        case 6:
            lines.insert(n, lines[m])
        case 7:
            del lines[n]
        case 8:
            lines[n] = lines[n][:start] + str(rng.choice(STRUCTURES)) + lines[n][start:]
        case _:
            lines[n] = lines[n].replace(*[(",", ";"), (".", ","), (" ", "\t"), ("-", ""), (":", "=")][m % 5])
    return "\n".join(lines).encode("utf-8", errors="surrogateescape")


def _other_digits(word: str, rng: np.random.Generator) -> str:
    """The word with a digit changed, put in or taken out."""
    at = int(rng.integers(0, len(word) + 1))
    return word[:at] + str(rng.choice([*"0123456789.-+e", "", "00000"])) + word[at + int(rng.integers(0, 2)) :]


def _bytes(content: bytes, rng: np.random.Generator) -> bytes:
    values, size = np.frombuffer(content, np.uint8).copy(), len(content)
    if not size:
        return bytes(rng.integers(0, 256, 8, np.uint8))
    near = size if rng.random() < 0.5 else min(size, 4096)
    start, length = int(rng.integers(0, near)), int(rng.integers(1, max(2, size // 8)))
    match int(rng.integers(0, 7)):
        case 0:
            values[rng.integers(0, near, 1 + int(rng.integers(0, 12)))] ^= np.uint8(1 << int(rng.integers(0, 8)))
        case 1:
            places = rng.integers(0, near, 1 + int(rng.integers(0, 12)))
            values[places] = rng.integers(0, 256, len(places))
        case 2:
            return content[:start]
        case 3:
            values[start : start + length] = 0
        case 4:
            values[start : start + 8] = 255  # lengths and counts beyond all measure
        case 5:
            return content[: start + length] + content[start:]
        case _:
            return content[:start] + content[start + length :]
    return values.tobytes()
