"""One table of measures; from it drawing, template, curves, meshes and collision shapes."""
