"""Datasets: record, convert, check, describe and push LeRobotDatasets of docking episodes."""
