"""Methods of visibility, a file each; `zbuf_occlude.visibility` has their table."""
