"""`physreal play`: a page in the browser on which a fitted twin is pulled, pinned, pushed on in time and changed."""
