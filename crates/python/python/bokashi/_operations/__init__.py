"""Operations that are described once, for numpy, torch and jax.

A description says which arrays the native module is given, in the order of gradients, what it runs, and what the
results look like. `bokashi`, `bokashi.torch` and `bokashi.jax` each make a function of it, by `dressed`.
"""

from .cameras import (
    affine_inverse, distort, fisheye, orthographic, pinhole, project, project_instances, rigid, se3, transform_normals,
    transform_points,
)
from .fragments import (
    antialias_image, depth, differentials, eye_depth, eye_depth_slope, interpolate, interpolate_differentials, picture,
    rasterize, render,
)
from .images import (
    depth_error, depth_of_field, downsample, exposure, gaussian_blur, halved, mean_error, multiscale_ssim_error, over,
    silhouette_error, squared_error, srgb_decode, srgb_encode, ssim_error, total_variation,
)
from .layers import composite_layers, depth_layers, lens_picture, rasterize_behind
from .light import (
    face_normals, irradiance, perturbed_normals, prefiltered, reflect, shade, shade_in_environment,
    tangents, vertex_normals,
)
from .meshes import (
    chamfer_distance, draw_points, edge_length_error, field_surface, laplacian_error, normal_error, rigid_error,
)
from .rows import cross, dot, gather_rows, matmul, norm, normalize, scatter_add_rows, sigmoid, softplus, sparse_product
from .step import Single, Step, dressed
from .textures import mipmaps, sample_cube_map, sample_texture
