"""Tools for developers: checks and pictures of Modelica libraries, and sample buses for both."""
