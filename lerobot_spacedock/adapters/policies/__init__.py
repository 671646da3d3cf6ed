"""The experts as LeRobot policy types; the module names follow LeRobot's lookup by name."""
