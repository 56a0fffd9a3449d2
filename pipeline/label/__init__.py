"""`physreal label`: a page in the browser on which one clicks object and hand, sees all masks at once, and mends a frame."""
