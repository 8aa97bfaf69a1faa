"""What several tests share: boards in memory, scenes, patched images, wild parameters."""
