"""Tools for developers: checks and pictures of Modelica libraries, and buses to try them on."""
