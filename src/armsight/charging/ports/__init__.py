"""One table of measures; from it drawing, template, curves and meshes."""
