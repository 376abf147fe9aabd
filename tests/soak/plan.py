"""What happens in a run, drawn from a seed: episodes of faults. Knows neither clocks nor sockets.

The same seed, transport and number of an episode give the same episode, whatever went before.
"""
import dataclasses
import random


@dataclasses.dataclass(frozen=True)
class Fault:
    """One kind of trouble: its weight in the draw, and how long it lasts, in seconds."""

    name: str
    weight: int
    shortest: float = 0.0
    longest: float = 0.0


@dataclasses.dataclass(frozen=True)
class Step:
    """A fault that begins after `wait` seconds and lasts `seconds`. `dice` is for its details."""

    fault: str
    wait: float
    seconds: float
    dice: int


@dataclasses.dataclass(frozen=True)
class Episode:
    number: int
    steps: tuple
    dice: int  # for the puts

    def words(self):
        return ", ".join(f"{s.fault} {s.seconds:.2f} s" for s in self.steps)


def chance(seed, *what):
    """A random generator of its own for each thing that is drawn."""
    return random.Random(":".join(str(word) for word in (seed, *what)))


def conflict(kind, kinds, apart):
    """Whether `kind` must not come together with one of those there. apart: (names, names) ..."""
    return any(kind in a and b & set(kinds) or kind in b and a & set(kinds) for a, b in apart)


def episode(seed, transport, number, faults, apart=()):
    """One to three faults, which may overlap: the next one begins before or after the end of one."""
    dice = chance(seed, transport, number)
    count = dice.choices((1, 2, 3), (6, 3, 1))[0]
    kinds = []
    for _ in range(count):
        free = [f for f in faults if f.weight and f.name not in [k.name for k in kinds]
                and not conflict(f.name, [k.name for k in kinds], apart)]
        if free:
            kinds += dice.choices(free, [f.weight for f in free])
    steps = tuple(Step(kind.name, round(dice.uniform(0, 1.0), 3),
                       round(dice.uniform(kind.shortest, kind.longest), 3), dice.randrange(1 << 30))
                  for kind in kinds)
    return Episode(number, steps, dice.randrange(1 << 30))
