"""Perception: masks, tracks and controller points from a video, through ONNX Runtime and OpenCV (paper, III-B).

Each part stands behind a protocol in its own file: `segmenter.Segmenter`, `chooser.TargetChooser`, `tracker.Tracker`,
`hand_finder.HandFinder`; `perceive.perceive` puts them together. Import from the modules: none is loaded here.
"""
