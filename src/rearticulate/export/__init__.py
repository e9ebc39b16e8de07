"""A fitted model in the formats of simulators and viewers. One format a module, all from one record (`robot.Robot`)."""
