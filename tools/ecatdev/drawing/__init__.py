"""Draws the icons and diagrams of Modelica classes as SVG, as an editor shows them.

It reads the annotations `Icon`, `Diagram`, `Placement` and `Line` of chapter 18 of the Modelica
specification, and follows inheritance, connectors and nested components. It is a tool of the
developers of the libraries: nothing of the generator needs it.

The modules, each of which knows those above it only:

- `tokens`, `expressions`, `syntax`: from text to classes, their elements and annotations
- `library`: finds classes by name
- `instances`: components with all their modifiers, and values of expressions
- `geometry`: boxes, transformations, curves
- `shapes`: from one graphical primitive to outlines and labels
- `scene`: everything that an icon or a diagram shows
- `svg`, `sheet`: writes scenes; several icons on one sheet
- `checks`: what is wrong with a scene
- `pictures`: the pictures of the documentation
"""
