//! How far beside an image a lens sees: how far away is what may be blurred into it.

use bokashi_core::Tensor;
use bokashi_render_ops::Size;

/// A margin is a multiple of so many pixels: it stays as it is while a lens is learnt, but for a few steps.
const STEP: usize = 8;
/// A circle of confusion lies between two rungs of a lens, of which the larger is up to this much larger.
const RUNG: f64 = 1.13;

/// The part of clip space that may be blurred into an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surroundings {
    /// The nearest distance that is seen.
    near: f64,
    /// What is seen has `|x| <= across w` and `|y| <= along w`.
    across: f64,
    along: f64,
}

impl Surroundings {
    /// Those of an image of this size, up to so many pixels beside it.
    pub(super) fn new(size: Size, pixels: f64, near: f64) -> Self {
        let [across, along] =
            [size.width, size.height].map(|extent| 1.0 + 2.0 * pixels / extent as f64);
        Self { near, across, along }
    }

    /// How far inside each plane a point x, y, w lies.
    fn inside(&self, [x, y, w]: [f64; 3]) -> [f64; 5] {
        let Self { near, across, along } = *self;
        [w - near, across * w - x, across * w + x, along * w - y, along * w + y]
    }

    /// The least and the largest distance of what these faces have inside; `None` where they have nothing there.
    pub(super) fn distances(&self, clip: &Tensor<f32>, faces: &[[u32; 3]]) -> Option<[f64; 2]> {
        let points = clip.data().chunks_exact(4).map(|p| [p[0], p[1], p[3]].map(f64::from));
        let points: Vec<_> = points.map(|point| (point, self.inside(point))).collect();
        let mut range: Option<[f64; 2]> = None;
        let mut add = |w: f64| {
            let [least, most] = range.unwrap_or([w; 2]);
            range = Some([least.min(w), most.max(w)]);
        };
        for face in faces {
            let corners = face.map(|vertex| points[vertex as usize]);
            if corners.iter().all(|(_, inside)| inside.iter().all(|&x| x >= 0.0)) {
                corners.iter().for_each(|([.., w], _)| add(*w));
            } else if (0..5).all(|k| corners.iter().any(|(_, inside)| inside[k] >= 0.0)) {
                self.cut(corners.map(|(point, _)| point)).iter().for_each(|[.., w]| add(*w));
            }
        }
        range
    }

    /// The corners of what of a triangle lies inside: it is cut by one plane after the other.
    fn cut(&self, corners: [[f64; 3]; 3]) -> Vec<[f64; 3]> {
        let mut polygon = corners.to_vec();
        for plane in 0..5 {
            let inside: Vec<_> = polygon.iter().map(|&point| self.inside(point)[plane]).collect();
            let mut kept = Vec::with_capacity(polygon.len() + 1);
            for (k, &from) in polygon.iter().enumerate() {
                let next = (k + 1) % polygon.len();
                let to = polygon[next];
                if inside[k] >= 0.0 {
                    kept.push(from);
                }
                if (inside[k] < 0.0) != (inside[next] < 0.0) {
                    let share = inside[k] / (inside[k] - inside[next]);
                    kept.push([0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis])));
                }
            }
            polygon = kept;
        }
        polygon
    }
}

/// The margin in pixels around an image whose circles of confusion have at most this radius.
pub(super) fn margin(radius: f64) -> usize {
    ((RUNG * radius + 1.0) as usize).next_multiple_of(STEP)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of points `[x, y, w]` in clip space, three for each face.
    fn distances(points: &[[f32; 3]]) -> Option<[f64; 2]> {
        let rows = points.iter().map(|&[x, y, w]| [x, y, 0.0, w]).collect::<Vec<_>>();
        let faces: Vec<_> =
            (0..points.len() as u32 / 3).map(|k| [0, 1, 2].map(|j| 3 * k + j)).collect();
        let size = Size { width: 100, height: 50 };
        // Up to x = 1.2 w and y = 1.4 w.
        Surroundings::new(size, 10.0, 0.5).distances(&Tensor::from(rows), &faces)
    }

    #[test]
    fn what_lies_beside_the_surroundings_has_no_distance() {
        let face = |x: f32, w: f32| [[x - 0.1, 0.0, w], [x + 0.1, 0.0, w], [x, 0.1, w]];
        assert_eq!(distances(&face(0.0, 2.0)), Some([2.0; 2]));
        assert_eq!(distances(&face(2.6, 2.0)), None);
        assert_eq!(distances(&face(0.0, 0.4)), None);
        let both = [face(0.0, 2.0), face(0.0, 7.0)].concat();
        assert_eq!(distances(&both), Some([2.0, 7.0]));
    }

    #[test]
    fn a_floor_that_goes_on_behind_the_eye_begins_where_it_is_seen() {
        // Points (X, -1, Z) of a camera with an angle of 90 degrees: the floor is seen from Z = 1 / 1.4 on.
        let floor = [[0.0, -1.0, -100.0], [1000.0, -1.0, 50.0], [-1000.0, -1.0, 50.0]];
        let [least, most] = distances(&floor).unwrap();
        assert!((least - 1.0 / 1.4).abs() < 1e-5 && (most - 50.0).abs() < 1e-5, "{least} {most}");
    }

    #[test]
    fn a_margin_is_wider_than_the_largest_circle() {
        assert_eq!([0.0, 6.0, 7.0, 64.0].map(margin), [8, 8, 8, 80]);
    }
}
