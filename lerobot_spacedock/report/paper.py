"""The numbers of Posadas-Nava et al. 2025 (arXiv 2509.04628), and what its published rollouts give instead."""

from __future__ import annotations

from dataclasses import dataclass

CITATION = (
    "A. Posadas-Nava, A. Scorsoglio, L. Ghilardi, R. Furfaro, R. Linares: Action Chunking with Transformers for "
    "Image-Based Spacecraft Guidance and Control, arXiv:2509.04628 (2025)"
)


@dataclass(frozen=True)
class PaperAccuracy:
    """A row of Table 3: ‖r_K‖ (m) and ‖v_K‖ (m/s) at mean, 75, 95 and 99 %, from ``same`` starts."""

    method: str
    distance_m: tuple[float, float, float, float]
    speed_m_s: tuple[float, float, float, float]


ACCURACY = (
    PaperAccuracy("ACT, paper", (0.992, 1.326, 1.763, 2.248), (0.086, 0.112, 0.141, 0.159)),
    PaperAccuracy("ACT, paper's rollouts", (0.9920, 1.3255, 1.7637, 2.2481), (0.0870, 0.1118, 0.1416, 0.1593)),
    PaperAccuracy("RL, paper", (1.391, 1.557, 1.738, 1.810), (0.092, 0.100, 0.110, 0.1241)),
)

# mean over all 100 of its ACT's published rollouts from `random`; its script drops those that end farther than 4 m away
RANDOM_DISTANCE_m = 5.59


@dataclass(frozen=True)
class PaperSmoothness:
    """A row of Table 4: Eq. 4, mean and spread over ``n`` episodes; ``shapiro_p`` where stated."""

    method: str
    conditions: str
    mean: float
    std: float
    n: int
    shapiro_p: float | None


SMOOTHNESS = (
    PaperSmoothness("ACT, paper", "random (the paper does not say so)", 1.71, 0.32, 100, 0.094),
    PaperSmoothness("ACT, paper's rollouts", "same", 3.359, 0.816, 100, 2e-6),
    PaperSmoothness("RL, paper", "same", 9.39, 0.74, 100, None),
)
WELCH_DF = 135


@dataclass(frozen=True)
class PaperSamples:
    """A row of Table 1: what a method saw. ``None`` where the paper does not say, or nothing applies."""

    method: str
    training_episodes: int | None
    training_interactions: int | None
    demonstrations: int | None
    demonstration_interactions: int | None


SAMPLES = (
    PaperSamples("ACT, paper", None, None, 100, 6_300),
    PaperSamples("ACT, corrected: 6,539 frames, and the expert's training", 612_000, 40_000_000, 100, 6_539),
    PaperSamples("RL, paper", 63_000, 40_000_000, None, None),
    PaperSamples("RL, corrected: 40 M at 65.4 steps an episode", 612_000, 40_000_000, None, None),
)

# set: position, velocity, attitude, rates
STARTS = {
    "same": ("x, z ∈ [−1, 1], y ∈ [−26, −24]", "0", "nominal, exact", "0"),
    "random": ("x, z ∈ [−2.5, 2.5], y ∈ [−27.5, −22.5]", "vx, vz ∈ ±0.1, vy ∈ [0, 0.2] †", "Euler ±1° †", "±0.1 †"),
    "same_dispersed": ("as same †", "as random †", "as random †", "as random †"),
}
STARTS_NOTE = "† not in the paper; found in its published rollouts."

SHARES = {  # conditions, tolerance in m: the paper's share, and its rollouts', in per cent
    ("same", 0.8): (43.0, 38.0),
    ("random", 4.0): (37.0, 37.0),
    ("random", 2.0): (5.0, 5.0),
}

ERRATA: tuple[tuple[str, str, str], ...] = (
    (
        "Smoothness of ACT",
        "1.71 ± 0.32 beside RL's 9.39 ± 0.74: 82 % smoother",
        "These are the episodes from random starts. From the starts that RL flew, the rollouts give 3.359 ± 0.816 "
        "(not normal, Shapiro p = 2e−6): 64 % smoother, and Welch's t-test rests on normality that is not there.",
    ),
    (
        "Within 80 cm, best",
        "43 %; 18 cm",
        "The rollouts give 38 % and 18.6 cm.",
    ),
    (
        "Random starts",
        "means over the episodes that end within 4 m",
        "Episodes beyond 4 m (63 of 100) are left out before averaging. Over all 100: mean 5.59 m, median 4.42 m. "
        "This report leaves out none.",
    ),
    (
        "Training of RL",
        "63,000 episodes, about 40 million interactions; “610 k” in the introduction",
        "40 million interactions at 65.4 steps are about 612,000 episodes: 63,000 is ten times too few.",
    ),
    (
        "Demonstrations",
        "6,300, 6,350 and 6,530 interactions, in different places",
        "The published dataset has 100 episodes and 6,539 frames.",
    ),
    (
        "Sample efficiency",
        "demonstrations alone are set against RL's interactions",
        "The demonstrations come from the trained RL policy: its interactions belong to the imitator's bill too.",
    ),
    (
        "Eq. 3, ensembling weights",
        "w_i = exp(−m i), i = 0 the most recent chunk",
        "ACT's and LeRobot's w_0 is the oldest prediction; the rollouts used LeRobot's, with coefficient 0.01.",
    ),
    (
        "Docking",
        "no contact model, no docking standard",
        "From the same starts none of the 100 rollouts meets the IDSS box at the port, and 22 fly through its plane.",
    ),
    (
        "Improvement in ‖r_K‖",
        "28 % and 29 %",
        "(1.391 − 0.992) / 1.391 = 28.7 %.",
    ),
    (
        "Starts",
        "positions only (Table 2); two sets",
        "The rollouts of the random set also scatter velocity, attitude and rates; a third set, with the near "
        "positions and that scatter, is in the rollouts and not in the paper.",
    ),
)
