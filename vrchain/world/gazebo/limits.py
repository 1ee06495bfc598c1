"""How large files from elsewhere may be: more than any world needs, less than harms."""

MOST_XML_BYTES = 16 << 20
MOST_XML_ELEMENTS = 400_000
MOST_XML_DEPTH = 100
MOST_SCRIPT_BYTES = 4 << 20
MOST_MESH_BYTES = 64 << 20
MOST_IMAGE_BYTES = 64 << 20
MOST_IMAGE_PX = 8192  # a side
TEXTURE_PX = 2048  # to which larger images are shrunk: no view shows more
MOST_TEXELS = 400_000_000  # of all textures of a world together
MOST_INCLUDES_DEEP = 16
MOST_MODELS = 10_000  # placed in a world
MOST_MESH_NODES = 20_000  # of a COLLADA file, every use of one counted
MOST_MESH_TRIANGLES = 2_000_000
MOST_TRIANGLES = 6_000_000  # of a world
MODEL_SIZE_M = (1e-3, 2000.0)
FARTHEST_M = 1e5  # of any place from the origin
MAP_M = 600.0  # widest map, as for scenes of our own
MOST_M2 = 4e6  # of faces on the map, which light falls on: five times both sides of a whole map
