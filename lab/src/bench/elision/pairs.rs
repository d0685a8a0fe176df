//! The pairs of steps that are compared, and their scenes.

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_render_ops::{Mesh, Size};
use glam::DVec4;

use super::step::Step;
use crate::bench::scenes::Scene;

/// The pairs of steps: the first computes what the second has no need of.
pub(super) fn pairs(pixels: usize) -> Result<Vec<(&'static str, Step, Step)>, FitError> {
    let scene = Scene::sphere("sphere1k", 32, 17, pixels)?;
    let (all, sharp) = (Step::new(&scene), Step::sharp(&scene));
    let lit = Step::lit(&scene);
    let textured = Step::textured(&scene);
    let single = textured.with_texture(|texture| texture.has_mipmaps = false);
    let still = Step { learns_positions: false, ..textured.clone() };
    let (crossing, apart) = beside_the_near_plane(&scene)?;
    let [torn, whole] = walls(pixels)?;
    Ok(vec![
        ("frozen positions", all.clone(), Step { learns_positions: false, ..all.clone() }),
        ("frozen colours", all.clone(), Step { learns_colors: false, ..all.clone() }),
        ("frozen sigma", all.clone(), Step { learns_sigma: false, ..all.clone() }),
        // So narrow a window has the weight 1 at its centre and nothing else.
        (
            "sigma 0",
            Step { sigma: Some(1e-3), ..all.clone() },
            Step { sigma: Some(0.0), ..all.clone() },
        ),
        ("antialias without discontinuities", Step::sharp(&torn), Step::sharp(&whole)),
        ("empty background", Step { has_background: true, ..sharp.clone() }, sharp.clone()),
        ("no face near the near plane", Step::sharp(&crossing), Step::sharp(&apart)),
        ("depth not asked for", Step { has_depth: true, ..sharp.clone() }, sharp.clone()),
        (
            "frozen positions of a lit surface",
            lit.clone(),
            Step { learns_positions: false, ..lit.clone() },
        ),
        ("frozen light", lit.clone(), Step { learns_light: false, ..lit }),
        ("texture without mipmaps", textured.clone(), single.clone()),
        (
            "differentials not asked for",
            single.clone(),
            single.with_texture(|texture| texture.has_differentials = false),
        ),
        (
            "frozen texels",
            textured.clone(),
            textured.with_texture(|texture| texture.learns_texels = false),
        ),
        (
            "fixed coordinates",
            still.clone(),
            still.with_texture(|texture| texture.learns_coordinates = false),
        ),
        ("a single layer", Step { layers: Some(Some(1)), ..sharp.clone() }, sharp.clone()),
        ("hidden layers", Step { layers: Some(None), ..sharp.clone() }, sharp.clone()),
        (
            "inference without gradients",
            all.clone(),
            Step {
                learns_positions: false,
                learns_colors: false,
                learns_sigma: false,
                ..all.clone()
            },
        ),
    ])
}

/// The scene with a face that reaches through the near plane beside the image, and without; its
/// three vertices are there in both.
fn beside_the_near_plane(scene: &Scene) -> Result<(Scene, Scene), FitError> {
    // Clip coordinates with w = 2, -2 and 2. So x / w is 4.5 and more, to the right of the image. But
    // the vertex behind the eye has x < -w, so that no plane has all three vertices beyond it.
    let (back, corners) =
        (scene.camera.inverse(), [(9.0, 0.0, 2.0), (-9.0, 1.0, -2.0), (12.0, 0.0, 2.0)]);
    let mut positions = scene.positions.data().to_vec();
    for (x, y, w) in corners {
        // What the camera makes of a depth of w.
        let z = (51.0 * w - 100.0) / 49.0;
        let point = back * DVec4::new(x, y, z, w);
        positions.extend(point.truncate().to_array());
    }
    let count = scene.mesh.vertex_count();
    let colors = [scene.colors.data(), &[0.5; 9]].concat();
    let with = |faces: Vec<[u32; 3]>| {
        Ok::<_, FitError>(Scene {
            mesh: Mesh::new(faces, count + 3)?,
            positions: Tensor::new([count + 3, 3], positions.clone())?,
            colors: Tensor::new([count + 3, 3], colors.clone())?,
            ..scene.clone()
        })
    };
    let apart = scene.mesh.faces().to_vec();
    let mut crossing = apart.clone();
    crossing.push([0, 1, 2].map(|k| count as u32 + k));
    Ok((with(crossing)?, with(apart)?))
}

/// Quads per side of the walls.
const QUADS: usize = 8;

/// A wall of a single colour that fills the image and more, made twice. First every face has vertices
/// of its own, so that all edges within the wall are silhouettes, whose blends change nothing. Then
/// faces share vertices, so that no edge is a silhouette.
fn walls(pixels: usize) -> Result<[Scene; 2], FitError> {
    let side = QUADS + 1;
    let mut shared = Vec::new();
    for k in 0..side * side {
        // A plane through the object's origin that faces the camera, larger than the view.
        let coordinate = |index: usize| 4.0 * index as f64 / QUADS as f64 - 2.0;
        shared.push([coordinate(k % side), coordinate(k / side)]);
    }
    let mut faces = Vec::new();
    for k in (0..QUADS * side).filter(|k| k % side < QUADS) {
        let (a, b, c, d) = (k, k + 1, k + side, k + side + 1);
        faces.extend([[a, b, d], [a, d, c]].map(|face| face.map(|vertex| vertex as u32)));
    }
    let model = Scene::cube(pixels)?;
    let (camera, size) = (model.camera, Size::square(pixels));
    let back = camera.inverse();
    let scene = |name: &str, faces: Vec<[u32; 3]>, vertices: Vec<[f64; 2]>| {
        // At w = 3.5, the distance of the object's origin.
        let w = 3.5;
        let point = |&[x, y]: &[f64; 2]| {
            let point = back * DVec4::new(x * w, y * w, (51.0 * w - 100.0) / 49.0, w);
            point.truncate().to_array()
        };
        let positions: Vec<f64> = vertices.iter().flat_map(point).collect();
        Ok::<_, FitError>(Scene {
            name: name.to_owned(),
            mesh: Mesh::new(faces, vertices.len())?,
            colors: Tensor::full([vertices.len(), 3], 0.5),
            positions: Tensor::new([vertices.len(), 3], positions)?,
            camera,
            size,
            has_creases: false,
        })
    };
    let apart = faces.iter().flatten().map(|&vertex| shared[vertex as usize]).collect();
    let apart_faces =
        (0..faces.len() as u32).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
    Ok([scene("torn wall", apart_faces, apart)?, scene("whole wall", faces, shared)?])
}
