"""Draws the icons and diagrams of Modelica classes as SVG, as an editor shows them.

It reads the annotations `Icon`, `Diagram`, `Placement` and `Line` (chapter 18 of the Modelica
specification), and follows inheritance, connectors and nested components. Developers of the
libraries use it; the generator does not need it.

The modules, each of which only imports those above it:

- `syntax`: from text to classes, their elements and annotations
- `library`: finds classes by name
- `instances`: components with all their modifiers, and values of expressions
- `geometry`: boxes, transformations, curves
- `shapes`: turns a graphical primitive into outlines and labels
- `scene`: everything that an icon or a diagram shows
- `svg`, `sheet`: write a scene, and the icons of a library on one sheet
- `checks`: finds errors in a scene
- `pictures`: the pictures of the documentation
"""
