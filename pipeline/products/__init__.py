"""What stages hand each other: one module a product, a frozen dataclass with `save(folder)` and `load(folder)`.

File names and the names of arrays and keys stand in these modules alone; a stage sees attributes with shapes and
units. A module is a dependency of every stage that reads or writes its product (docs/pipeline.md).
"""
