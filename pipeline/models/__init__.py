"""The pretrained networks: what there is, how to get it, how to be sure that it is what it should be."""

from pipeline.models.fetch import check_files, default_folder, fetch, require

__all__ = ["check_files", "default_folder", "fetch", "require"]
