"""The perfusion map: images, cells of the left ventricle, territories."""
