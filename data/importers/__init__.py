"""From other people's recordings to capture folders: one module per kind, each with `import_capture`.

`import_capture(source, destination, **options)` reads `source` without changing it and writes a whole capture folder
or nothing.
"""
