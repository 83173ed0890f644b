"""The generator: bus description to Modelica library."""
