"""Every per-episode metric once: its name, unit and meaning. What ``episode_metrics`` returns, in this order."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """One number an episode.

    Attributes:
        name: key in the JSON, unit suffixed.
        label: as in a table's head.
        unit: for people; empty for counts and shares.
        meaning: one line.
        kind: ``number`` or ``flag``.
    """

    name: str
    label: str
    unit: str
    meaning: str
    kind: str = "number"


CATALOG: tuple[Metric, ...] = (
    Metric("steps", "steps", "", "interactions with the environment"),
    Metric("duration_s", "duration", "s", "time from the first state to the last"),
    Metric("start_misalignment_deg", "attitude error at the start", "°", "angle to the docking attitude, first state"),
    Metric("final_distance_m", "‖r_K‖", "m", "distance from the port at the last state"),
    Metric("final_speed_m_s", "‖v_K‖", "m/s", "speed at the last state"),
    Metric("final_misalignment_deg", "attitude error", "°", "angle to the docking attitude at the last state"),
    Metric("final_rate_deg_s", "rate", "°/s", "norm of the angular velocity against the station, last state"),
    Metric("final_closing_m_s", "closing rate at the end", "m/s", "speed towards the port along its axis, last state"),
    Metric("closest_approach_m", "closest approach", "m", "least distance from the port, straight between states"),
    Metric("crossed", "crossed the plane", "", "the port plane was reached", "flag"),
    Metric("crossing_time_s", "crossing time", "s", "when the port plane was crossed"),
    Metric("lateral_m", "lateral miss", "m", "distance from the port axis at contact"),
    Metric("closing_speed_m_s", "closing rate", "m/s", "speed along the port axis at contact"),
    Metric("lateral_speed_m_s", "lateral rate", "m/s", "speed across the port axis at contact"),
    Metric("pitch_yaw_deg", "pitch/yaw", "°", "angle between the docking axes at contact"),
    Metric("roll_deg", "roll", "°", "angle about the docking axis at contact"),
    Metric("pitch_yaw_rate_deg_s", "pitch/yaw rate", "°/s", "angular velocity across the docking axis at contact"),
    Metric("roll_rate_deg_s", "roll rate", "°/s", "angular velocity about the docking axis at contact"),
    Metric("success", "success", "", "as the log states it, else the IDSS box", "flag"),
    Metric("idss", "IDSS box", "", "all IDSS initial contact conditions at contact", "flag"),
    Metric("atv", "ATV box", "", "closing speed and lateral offset at contact as for ATV, no more", "flag"),
    Metric("corridor_violated", "left the corridor", "", "a state lay outside the approach corridor", "flag"),
    Metric("corridor_share", "share outside", "", "share of states outside the approach corridor"),
    Metric("fly_through", "flew through", "", "crossed the plane, outside the IDSS box there and at contact", "flag"),
    Metric("smoothness", "‖Δa‖ (Eq. 4)", "N, N·m mixed", "mean norm of the change of command, as in the paper"),
    Metric("smoothness_thrust_N", "‖ΔT‖", "N", "the same for thrust alone"),
    Metric("smoothness_torque_Nm", "‖ΔL‖", "N·m", "the same for torque alone"),
    Metric("smoothness_per_limit", "‖Δa‖ / limit", "", "the same, each command as a share of its limit"),
    Metric("smoothness_thrust_N_s", "‖ΔT‖ per second", "N/s", "total change of thrust over the time it took"),
    Metric("smoothness_torque_Nm_s", "‖ΔL‖ per second", "N·m/s", "total change of torque over the time it took"),
    Metric("smoothness_per_limit_s", "‖Δa‖ / limit per second", "1/s", "the same, as shares of the limits"),
    Metric("delta_v_m_s", "Δv", "m/s", "commanded thrust over mass, integrated"),
    Metric("propellant_kg", "propellant", "kg", "mass at the start minus mass at the end"),
    Metric("impulse_N_s", "impulse", "N·s", "norm of commanded thrust, integrated"),
    Metric("angular_impulse_N_m_s", "angular impulse", "N·m·s", "norm of commanded torque, integrated"),
    Metric("peak_thrust_N", "peak thrust", "N", "largest norm of commanded thrust"),
    Metric("peak_torque_Nm", "peak torque", "N·m", "largest norm of commanded torque"),
    Metric("saturated_share", "saturated", "", "share of steps with a command at its limit"),
    Metric("clipped_actions", "clipped", "", "steps whose command had to be clipped, as the log states it"),
    Metric("reward_sum", "return", "", "sum of rewards"),
    Metric("inference_ms", "inference", "ms", "mean time the policy took for a step of its batch, warm-up left out"),
    Metric("inference_max_ms", "longest inference", "ms", "longest time it took for one, warm-up left out"),
    Metric("inference_batch", "batch", "", "episodes that the policy was asked for at once"),
)
NAMES: tuple[str, ...] = tuple(metric.name for metric in CATALOG)
BY_NAME: dict[str, Metric] = {metric.name: metric for metric in CATALOG}

LADDER_M = (0.1, 0.18, 0.8, 2.0, 4.0)  # the tolerances that the paper's text names, and the IDSS lateral limit
