"""Triangle meshes: closed surfaces, and the tool."""
