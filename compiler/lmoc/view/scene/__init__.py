"""The picture of a scene, from the flat model alone: layout, symbols, and the writers of SVG, PNG and PDF."""
