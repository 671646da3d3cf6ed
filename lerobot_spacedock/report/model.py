"""What a report is made of: runs, their episodes, and what was stated about their training."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations

from lerobot_spacedock.metrics.collect import EpisodeSet, Exclusion
from lerobot_spacedock.metrics.task import Task
from lerobot_spacedock.report.runs import RunSpec

ORDER = ("same", "random", "same_dispersed")


@dataclass(frozen=True)
class Samples:
    """What a method saw on its way; ``None``: not stated."""

    training_episodes: int | None = None
    training_interactions: int | None = None
    demonstrations: int | None = None
    demonstration_interactions: int | None = None
    flown_episodes: int | None = None
    expert: str | None = None


@dataclass
class Run:
    """One label: its episodes by set of initial conditions."""

    spec: RunSpec
    sets: dict[str, EpisodeSet]
    exclusions: list[Exclusion] = field(default_factory=list)
    samples: Samples | None = None

    @property
    def label(self) -> str:
        return self.spec.label

    @property
    def task(self) -> Task:
        """What all of its episodes were flown to do."""
        return next(iter(self.sets.values())).task


@dataclass
class Study:
    """All runs of a report, in the order given.

    Attributes:
        reference: label of the run whose Δv others are set against; ``None``: there is none.
    """

    runs: list[Run]
    reference: str | None = None

    def conditions(self) -> list[str]:
        """Sets of initial conditions that any run has, the paper's first."""
        names = {name for run in self.runs for name in run.sets}
        return [name for name in ORDER if name in names] + sorted(names - set(ORDER))

    def flown(self, conditions: str) -> Iterator[tuple[Run, EpisodeSet]]:
        """Runs that flew this set, with their episodes."""
        for run in self.runs:
            if conditions in run.sets:
                yield run, run.sets[conditions]

    def groups(self) -> Iterator[tuple[str, Run, EpisodeSet]]:
        """(conditions, run, episodes), set by set."""
        for conditions in self.conditions():
            for run, episodes in self.flown(conditions):
                yield conditions, run, episodes

    def pooled(self) -> tuple[str, ...]:
        """What a reader of intervals and tests has to know where a run has several training seeds; else nothing."""
        runs = sorted({run.label for _, run, episodes in self.groups() if episodes.training_seeds > 1})
        if not runs:
            return ()
        return (
            f"{', '.join(runs)}: episodes of several training seeds, taken together as if they were independent. The "
            "intervals and tests are of these networks, not of training again: for that see the spread over training "
            "seeds.",
        )

    def mixed(self) -> tuple[str, ...]:
        """What a reader of comparisons has to know where runs flew different tasks or ports; else nothing."""
        if all(a.task.agrees(b.task) for a, b in combinations(self.runs, 2)):
            return ()
        flown = "; ".join(f"{run.label}: {run.task}" for run in self.runs)
        return (f"Different tasks ({flown}): between their runs a difference is the task's as well as the policy's.",)

    def beside_the_paper(self) -> tuple[str, ...]:
        """What a reader of the paper's rows has to know where a run's task is to touch the port; else nothing."""
        labels = [run.label for run in self.runs if run.task.contact]
        if not labels:
            return ()
        return (
            f"{', '.join(labels)}: a task that ends at contact, where a flight that docks is at the port by definition."
            " The paper's numbers are of 65 steps without contact, as in SpaceDock-v0: not of the same task.",
        )

    def colour(self, run: Run) -> int:
        """Place of a run, which fixes its colour, line and marker in every figure."""
        return self.runs.index(run)
