import torch

from skillcli.seeding import generator, torch_generator


def test_a_seed_and_a_use_always_give_the_same_numbers() -> None:
    # Fixed for good: a change here changes every trained artifact.
    assert generator(0, "training").integers(1000, size=4).tolist() == generator(0, "training").integers(1000, size=4).tolist()
    drawn = [torch.rand(3, generator=torch_generator(7, "networks")).tolist() for _ in range(2)]
    assert drawn[0] == drawn[1]


def test_uses_and_seeds_are_independent() -> None:
    streams = [generator(seed, use).random(1000) for seed in (0, 1, 2**63 - 1) for use in ("training", "evaluation")]
    for i, a in enumerate(streams):
        for b in streams[i + 1 :]:
            assert abs(float(((a - a.mean()) * (b - b.mean())).mean() * 12)) < 0.12


def test_drawing_more_for_one_use_does_not_shift_another() -> None:
    greedy, modest = generator(3, "a"), generator(3, "b")
    greedy.random(10_000)
    assert modest.random() == generator(3, "b").random()
