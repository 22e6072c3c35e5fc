"""What the words of `wiclosure compare` ask to compare."""

from __future__ import annotations

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cli.compare import make_plan
from wiclosure.pipeline.cli.options import Configuration, RecordingOptions


def test_presets_are_laid_over_the_configuration() -> None:
    settings = Configuration(config="small-site", set_=["keyframes.distance_m=3"])
    plan = make_plan(
        ["alpha"], "none, wiclosure", "strong,disco-park", configuration=settings, reading=RecordingOptions()
    )
    assert list(plan.configs) == ["strong", "disco-park"]
    assert plan.filters == ("none", "wiclosure")
    assert {config.filter.gate.sensor_range_m for config in plan.configs.values()} == {15.0}
    assert {config.keyframes.distance_m for config in plan.configs.values()} == {3.0}
    assert plan.configs["disco-park"].pcm.cycle == "legacy"
    assert (plan.remarks, [world.draws for world in plan.worlds]) == ((), [(0,)])


def test_without_presets_the_configuration_names_the_arm() -> None:
    for config, name in ((None, "default"), ("small-site", "small-site")):
        plan = make_plan(["alpha"], "none", configuration=Configuration(config=config), reading=RecordingOptions())
        assert list(plan.configs) == [name]


def test_seeds_of_a_scenario_are_worlds_and_those_of_recordings_are_draws() -> None:
    word = ["scenario:demo-site,seed=3"]
    plan = make_plan(word, "random", seeds=2, configuration=Configuration(), reading=RecordingOptions(n_scans=5))
    assert [(world.seed, world.draws) for world in plan.worlds] == [(3, (3,)), (4, (4,))]
    assert len(plan.worlds[0].inputs().robots[0].scans) == 5
    plan = make_plan(["alpha"], "none,random", seeds=2, configuration=Configuration(seed=7), reading=RecordingOptions())
    assert [(world.seed, world.draws) for world in plan.worlds] == [(7, (7, 8))]
    assert "recordings are one world" in plan.remarks[0]


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("none,magick",), ["magick"]),
        (("none,oracl",), ["oracl", "did you mean oracle"]),
        (("none,none",), ["none is named twice"]),
        (("",), ["--filters"]),
        (("none", "disco-prak"), ["disco-prak", "did you mean disco-park"]),
        (("none", "strong,disco-park,strong"), ["strong is named twice"]),
    ],
)
def test_bad_plans_are_one_sentence(words: tuple[str, ...], parts: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        make_plan(["alpha"], *words, configuration=Configuration(), reading=RecordingOptions())
    for part in parts:
        assert part in str(error.value)


def test_a_scenario_has_its_seed_in_its_name_and_stands_alone() -> None:
    with pytest.raises(ConfigError, match=r"--seed: the seed of a scenario is named with it"):
        make_plan(["scenario:city"], "none", configuration=Configuration(seed=1), reading=RecordingOptions())
    with pytest.raises(ConfigError, match="a scenario stands alone"):
        make_plan(["scenario:city", "a=b"], "none", configuration=Configuration(), reading=RecordingOptions())
    with pytest.raises(ConfigError, match="a scenario stands alone"):
        reading = RecordingOptions(wireless=["radio.jsonl"])
        make_plan(["scenario:city"], "none", configuration=Configuration(), reading=reading)
