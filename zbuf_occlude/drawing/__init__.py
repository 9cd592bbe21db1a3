"""Pictures of clouds and meshes, and pages with clouds to be turned by hand."""
