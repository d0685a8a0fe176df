//! Scenes that aim at trouble.

use bokashi_check::strategy::{
    aligned, camera, closed_mesh, sliver, through_the_eye, triangle, well_shaped,
};
use bokashi_core::Tensor;
use bokashi_render_ops::{Mesh, Size};
use glam::DMat4;
use proptest::collection::vec;
use proptest::prelude::*;

/// Faces, clip positions and an image size.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The faces.
    pub mesh: Mesh,
    /// `[V, 4]`.
    pub clip: Tensor<f64>,
    /// Of the image.
    pub size: Size,
}

/// The size of an image.
pub fn size(width: usize, height: usize) -> Size {
    Size { width, height }
}

/// Images of a few pixels to a few dozen, a row and a column among them.
pub fn sizes() -> impl Strategy<Value = Size> {
    let extents = prop_oneof![
        4 => (4..13_usize, 4..13_usize),
        1 => (2..13_usize, Just(1)),
        1 => (Just(1), 2..13_usize),
    ];
    extents.prop_map(|(width, height)| size(width, height))
}

/// A scene of vertices in clip space and of faces.
///
/// # Panics
/// Where a face names a vertex that is not there.
pub fn scene(vertices: Vec<[f64; 4]>, faces: Vec<[u32; 3]>, size: Size) -> Scene {
    let mesh = Mesh::new(faces, vertices.len()).unwrap();
    let clip = Tensor::from_flat_fn([vertices.len(), 4], |k| vertices[k / 4][k % 4]);
    Scene { mesh, clip, size }
}

/// Three faces that share no vertex.
pub fn loose(triangle: BoxedStrategy<[[f64; 4]; 3]>) -> BoxedStrategy<Scene> {
    (vec(triangle, 3), sizes())
        .prop_map(|(triangles, size)| {
            let faces = (0..3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
            scene(triangles.concat(), faces, size)
        })
        .boxed()
}

/// Three faces on pixel centres and corners, off by so little that a difference quotient can still
/// stay on one side: a face that passes through a centre has no derivative.
pub fn beside_pixel_centres() -> BoxedStrategy<Scene> {
    let offset = || prop_oneof![1e-4..1e-3, -1e-3..-1e-4];
    let nudged = (aligned(8), [offset(), offset(), offset(), offset(), offset(), offset()]);
    let nudged = nudged.prop_map(|(mut triangle, offsets)| {
        for (k, offset) in offsets.into_iter().enumerate() {
            triangle[k / 2][k % 2] += offset;
        }
        triangle
    });
    loose(nudged.boxed())
}

/// A closed mesh seen by a camera: all around, from within, through the near plane.
pub fn closed() -> BoxedStrategy<Scene> {
    (closed_mesh(), camera(), sizes())
        .prop_map(|(mesh, camera, size)| {
            let camera = DMat4::from_cols_array_2d(&camera);
            let clip = |p: &[f64; 3]| (camera * glam::DVec3::from(*p).extend(1.0)).to_array();
            scene(mesh.positions.iter().map(clip).collect(), mesh.faces, size)
        })
        .boxed()
}

/// Kinds of scenes.
pub fn scenes() -> Vec<(&'static str, BoxedStrategy<Scene>)> {
    vec![
        ("faces", loose(well_shaped())),
        ("slivers", loose(sliver())),
        ("faces beside pixel centres", beside_pixel_centres()),
        ("faces through the eye", loose(through_the_eye())),
        ("triangles of every kind", loose(triangle())),
        ("closed meshes", closed()),
    ]
}

/// Numbers of which no two are alike, for images of a size that is known only later.
pub fn motley(k: usize) -> f64 {
    ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5
}
