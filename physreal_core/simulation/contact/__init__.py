"""Contact of a body with itself: layers of sheets, strands of ropes, parts and pieces of volumes."""
