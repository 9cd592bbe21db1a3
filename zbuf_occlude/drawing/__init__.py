"""Pictures of clouds and meshes, and pages with an interactive viewer."""
