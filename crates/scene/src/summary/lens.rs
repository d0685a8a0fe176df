//! Edges that a lens bends: a mesh is drawn with straight ones.

use bokashi_core::Tensor;
use bokashi_render_ops::RenderError;
use glam::{DMat4, DVec2, DVec3};

use crate::cameras::Camera;
use crate::object::Object;
use crate::scene::Scene;
use crate::scene_view::SceneView;

/// Edges are bent so many at a time.
const AT_A_TIME: usize = 1 << 14;
/// Places on an edge, as shares of its length, besides its ends.
const PLACES: [f64; 3] = [0.25, 0.5, 0.75];
/// An edge is looked at where the square of its length, as an angle, times the focal length in pixels is above it:
/// an eighth of that, times how strongly the lens bends, is how far off its middle can be.
const LEAST: f64 = 0.25;
/// From the centre of a pixel to its border.
const HALF: f64 = 0.5;

/// The edge of an object that a view's lens bends most.
#[derive(Debug, Clone, PartialEq)]
pub struct BentEdge {
    /// The view's name.
    pub view: String,
    /// The object's name.
    pub object: String,
    /// How far it is off the straight edge that is drawn, in pixels of the view.
    pub pixels: f64,
}

/// Of each view whose lens bends edges inside its image by more than `least` pixels, the edge that it bends most.
/// Edges are taken where objects are before a fit; what hides them is not asked.
///
/// # Errors
/// Those of coefficients that the operation refuses.
pub fn most_bent_edges(scene: &Scene, least: f64) -> Result<Vec<BentEdge>, RenderError> {
    let has_lens = |view: &&SceneView| !view.camera.distortion.is_none();
    let views: Vec<_> = scene.views.iter().filter(has_lens).collect();
    if views.is_empty() {
        return Ok(Vec::new());
    }
    let edges: Vec<_> = scene.objects.iter().map(edges).collect();
    let mut bent = Vec::new();
    for view in views {
        let mut most: Option<BentEdge> = None;
        for (object, edges) in scene.objects.iter().zip(&edges) {
            for transform in &object.places {
                let pixels = most_bent(object, edges, transform, &view.camera)?;
                if pixels > most.as_ref().map_or(least, |most| most.pixels) {
                    let (view, object) = (view.name.clone(), object.name.clone());
                    most = Some(BentEdge { view, object, pixels });
                }
            }
        }
        bent.extend(most);
    }
    Ok(bent)
}

/// A note of edges that lenses bend by more than half a pixel, since faces are drawn with straight edges.
///
/// # Errors
/// As [`most_bent_edges`].
pub fn lens_note(scene: &Scene) -> Result<Option<String>, RenderError> {
    let bent = most_bent_edges(scene, HALF)?;
    let most = bent.iter().max_by(|a, b| a.pixels.total_cmp(&b.pixels));
    let Some(BentEdge { view, object, pixels }) = most else { return Ok(None) };
    let views = match bent.len() {
        1 => "the lens of 1 view bends edges".to_owned(),
        count => format!("the lenses of {count} views bend edges"),
    };
    let rule = "of faces that are drawn with straight ones: smaller faces are nearer";
    let worst = format!("an edge of {object:?} in view {view:?} is off by {pixels:.1} pixels");
    Ok(Some(format!("{views} {rule}; {worst}")))
}

/// The edges of an object, each once.
fn edges(object: &Object) -> Vec<[u32; 2]> {
    let sides = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    let faces = object.mesh.faces().iter();
    let mut edges: Vec<_> = faces.flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// By how many pixels the edges of an object in one place are bent at most inside the image.
fn most_bent(
    object: &Object,
    edges: &[[u32; 2]],
    transform: &DMat4,
    camera: &Camera,
) -> Result<f64, RenderError> {
    let [fx, fy, cx, cy] = camera.intrinsics;
    let [width, height] = [camera.size.width, camera.size.height].map(|extent| extent as f64);
    let to_camera = camera.view * *transform;
    let points: Vec<_> = object.points().map(|point| to_camera.transform_point3(point)).collect();
    let is_long = |&&[a, b]: &&[u32; 2]| {
        let [a, b] = [a, b].map(|k| points[k as usize]);
        let near = a.length_squared().min(b.length_squared());
        fx.max(fy) * a.distance_squared(b) > LEAST * near
    };
    let long: Vec<_> = edges.iter().filter(is_long).collect();
    let each = PLACES.len() + 2;
    let mut most = 0.0_f64;
    for some in long.chunks(AT_A_TIME) {
        let on_edges: Vec<[f64; 3]> = some
            .iter()
            .flat_map(|&&[a, b]| {
                let [a, b] = [a, b].map(|k| points[k as usize]);
                let between = PLACES.map(|share| a.lerp(b, share));
                [a, b].into_iter().chain(between).map(|point| point.to_array())
            })
            .collect();
        let bent = camera.distortion.bent(&Tensor::from(on_edges))?;
        // In pixels, but for the division by the third.
        let bent: Vec<_> = bent
            .data()
            .chunks_exact(3)
            .map(|p| DVec3::new(fx * p[0] + cx * p[2], fy * p[1] + cy * p[2], p[2]))
            .collect();
        for edge in bent.chunks_exact(each) {
            let line = edge[0].cross(edge[1]);
            let across = line.truncate().length();
            for point in edge[2..].iter().filter(|point| point.z > 0.0) {
                let pixel: DVec2 = point.truncate() / point.z;
                let is_inside = (-HALF..width - HALF).contains(&pixel.x)
                    && (-HALF..height - HALF).contains(&pixel.y);
                let off = line.dot(pixel.extend(1.0)).abs() / across;
                if is_inside && off.is_finite() {
                    most = most.max(off);
                }
            }
        }
    }
    Ok(most)
}
