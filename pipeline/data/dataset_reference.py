"""The reference of `dataset.yaml`, made of the keys themselves.

`python -m wiclosure.pipeline.data.dataset_reference > docs/dataset.md` writes it.
"""

from __future__ import annotations

import sys

from wiclosure.pipeline.data.robot_keys import ROBOT_KEYS
from wiclosure.pipeline.radio.source import keys

_HEAD = """\
# dataset.yaml, key by key

`wiclosure init FOLDER` writes one with comments from what it finds. Paths are relative to the file; `~` is the home
folder. A key that is not listed here is an error that names it.

```yaml
robots:
  alpha: {scans: alpha.bag, topic: /points, ground_truth: alpha_gt.tum}
  beta: {scans: beta_bag/, time_offset: -0.2}
wireless:
  - radio.jsonl
  - {path: uwb.csv, stamp: time_ms, stamp_unit: ms, range: dist_mm, unit: mm, robots: {7: alpha, 12: beta}}
```

## Clocks

All stamps end up in one clock, that of the robots after their `time_offset`s:

- scans, odometry and ground truth of a robot: its own stamp **+** its `time_offset`;
- radio: the log's stamp **+** the source's `time_offset`, which must give the clock of the robot that received (as its
  bag has it); then that robot's `time_offset` is added as for everything else of it.

So where a laptop logged all radio in a clock of its own, the source's `time_offset` is what is missing to the robots'.
`wiclosure radio check` estimates it.

## `robots`: one entry for each, by name

Names are letters, digits, `_`, `-` and `.`; not `team`.

"""
_RADIO = """
## `wireless`: a list of radio logs

Each entry is a path, or a mapping with these keys. The same keys go behind the path on the command line:
`--wireless uwb.csv,unit=mm,robots.7=alpha`, or into a YAML file of one source or more
(`--wireless radio.yaml`).
Examples of each kind, and the presets: [radio.md](radio.md). A log in JSON Lines and the project's own messages in bags
need no keys; `unit`, `clockwise` and the like correct them where they are wrong.

"""


def dataset_reference() -> str:
    """The whole page as Markdown."""
    robots = ["| key | value | meaning |", "|---|---|---|"]
    robots += [f"| `{name}` | {key.kind} | {key.meaning} |" for name, key in ROBOT_KEYS.items()]
    radio = ["| key | default | meaning |", "|---|---|---|"]
    for name, field in keys().items():
        default = "" if field.default in (None, (), {}) else f"`{str(field.default).lower()}`"
        radio.append(f"| `{name}` | {default} | {field.description} |")
    return _HEAD + "\n".join(robots) + "\n" + _RADIO + "\n".join(radio) + "\n"


if __name__ == "__main__":
    sys.stdout.write(dataset_reference())
