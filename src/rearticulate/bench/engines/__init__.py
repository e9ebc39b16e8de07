"""Simulators that an export is loaded into, one a module, all with the methods of `engine.Engine`."""
