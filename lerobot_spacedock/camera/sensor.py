"""Placeholder until the sensor model lands."""


class Sensor:
    def __init__(self, config):
        self.config = config

    def expose(self, linear, generator):
        raise NotImplementedError
