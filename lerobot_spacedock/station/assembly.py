"""The whole station, module by module."""

from __future__ import annotations

import numpy as np

from . import american, ports, russian, truss, vehicles
from .builder import Builder
from .shapes import Patch, pose

HARMONY_FORWARD = (0.19, -20.84, -3.34)


def assemble(detail: str, port: str) -> tuple[Patch, np.ndarray, np.ndarray]:
    """Every triangle in station axes, with material and segment.

    Args:
        detail: ``low`` or ``high``.
        port: the port to dock at, which is built in full.
    """
    b = Builder(high=detail == "high")
    russian.zvezda(b)
    ports.zvezda_port(b, pose(russian.ZVEZDA_AFT, russian.AFT, russian.ZENITH), near=port == "zvezda_aft")
    russian.zarya(b)
    russian.poisk(b)
    russian.rassvet(b)
    russian.nauka(b)
    russian.prichal(b)
    american.nodes_and_labs(b)
    american.forward_adapter(b)
    ports.harmony_port(b, pose(HARMONY_FORWARD, russian.FORWARD, russian.ZENITH), near=port == "harmony_forward")
    american.columbus(b)
    american.kibo(b)
    american.tranquility(b)
    truss.truss(b)
    truss.wings(b)
    truss.radiators(b)
    truss.canadarm(b)
    vehicles.fleet(b)
    return b.result()
