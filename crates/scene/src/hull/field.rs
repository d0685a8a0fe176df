//! The field of a hull over a grid: agreed distances, samples, and smoothing.

use std::ops::RangeInclusive;

use bokashi_core::parallel::{for_each_item_mut, write_each};
use bokashi_mesh::Grid;
use glam::DVec3;

/// The number of points along a side of a block.
const SIDE: usize = 8;
/// The number of points in one piece of work.
const POINTS_PER_PIECE: usize = 1 << 15;

/// The largest of a point's distances from silhouettes after so many of the largest ones are left out. Where it is
/// below 0, the point is inside for all other views. `None` where fewer than half of all `views` have a distance.
pub(super) fn agreed(distances: &mut [f64], views: usize, left_out: usize) -> Option<f64> {
    if 2 * distances.len() < views || distances.len() <= left_out {
        return None;
    }
    let taken = distances.len() - 1 - left_out;
    Some(*distances.select_nth_unstable_by(taken, f64::total_cmp).1)
}

/// Samples `field` at all points of the grid. Where it is `None`, a point is outside. A block of points far from the
/// surface has the value at its middle, which has the right sign. The field changes at most `steepness` times as fast
/// as the position.
pub(super) fn sampled(
    grid: &Grid,
    steepness: f64,
    field: impl Fn(DVec3) -> Option<f64> + Sync,
) -> Vec<f32> {
    let shape = grid.shape();
    let blocks = shape.map(|points| points.div_ceil(SIDE));
    // No point of a block is farther from its middle than half the diagonal. So the field has no zero in a block where
    // it is larger at the middle.
    let reach = steepness * 0.5 * 3.0_f64.sqrt() * SIDE as f64 * grid.spacing();
    let mut values = vec![Vec::new(); blocks.iter().product()];
    let range = |block: usize, axis: usize| {
        let place =
            [block / (blocks[1] * blocks[2]), block / blocks[2] % blocks[1], block % blocks[2]];
        let first = SIDE * place[axis];
        first..=(first + SIDE - 1).min(shape[axis] - 1)
    };
    let position = |place: [usize; 3]| {
        DVec3::from(grid.position((place[0] * shape[1] + place[1]) * shape[2] + place[2]))
    };
    for_each_item_mut(&mut values, |block, values| {
        let [x, y, z] = [0, 1, 2].map(|axis| range(block, axis));
        let ends = [RangeInclusive::start, RangeInclusive::end];
        let [low, high] = ends.map(|end| position([&x, &y, &z].map(|range| *end(range))));
        if let Some(middle) = field(0.5 * (low + high)).filter(|middle| middle.abs() > reach) {
            values.push(middle as f32);
            return;
        }
        let value = |place| field(position(place)).unwrap_or(grid.spacing()) as f32;
        for i in x {
            for j in y.clone() {
                values.extend(z.clone().map(|k| value([i, j, k])));
            }
        }
    });
    let block_of = |place: [usize; 3]| {
        let [i, j, k] = place.map(|x| x / SIDE);
        (i * blocks[1] + j) * blocks[2] + k
    };
    let value = |point: usize| {
        let place = grid.place(point);
        let block = block_of(place);
        match values[block].as_slice() {
            [only] => *only,
            all => {
                let [_, y, z] = [0, 1, 2].map(|axis| range(block, axis).count());
                let [i, j, k] = place.map(|x| x % SIDE);
                all[(i * y + j) * z + k]
            }
        }
    };
    (0..grid.point_count()).map(value).collect()
}

/// Smooths a field by means over neighbours, with the weights 1, 2 and 1 along each axis. Two passes leave no sheet and
/// no gap of a third of a cell's width and less.
pub(super) fn smoothed(grid: &Grid, mut values: Vec<f32>) -> Vec<f32> {
    let [_, ny, nz] = grid.shape();
    let mut means = vec![0.0; values.len()];
    for (extent, stride) in grid.shape().into_iter().zip([ny * nz, nz, 1]) {
        write_each(&mut means, POINTS_PER_PIECE, |point| {
            let place = point / stride % extent;
            let before = values[if place > 0 { point - stride } else { point }];
            let after = values[if place + 1 < extent { point + stride } else { point }];
            0.25 * (before + after) + 0.5 * values[point]
        });
        std::mem::swap(&mut values, &mut means);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The distance from a ball.
    fn ball(center: DVec3, radius: f64) -> impl Fn(DVec3) -> f64 + Sync {
        move |point| point.distance(center) - radius
    }

    #[test]
    fn blocks_that_are_not_looked_into_have_the_sign_of_the_field() {
        // Blocks are cut off at the ends, and the ball is a point of some cells in one case.
        for (shape, radius) in
            [([20, 9, 33], 0.4), ([8, 8, 8], 0.3), ([41, 40, 39], 0.05), ([2, 2, 2], 1.0)]
        {
            let grid = Grid::new(shape, [-0.5; 3], 0.04).unwrap();
            let field = ball(DVec3::new(0.1, -0.2, 0.3), radius);
            let values = sampled(&grid, 1.0, |point| Some(field(point)));
            assert_eq!(values.len(), grid.point_count());
            for (point, value) in values.into_iter().enumerate() {
                let expected = field(DVec3::from(grid.position(point))) as f32;
                assert_eq!(value < 0.0, expected < 0.0, "{shape:?} {point}");
                assert!(value == expected || expected.abs() > 0.04, "{value} for {expected}");
            }
        }
    }

    #[test]
    fn means_over_neighbours_keep_what_is_straight_and_leave_no_thin_sheet() {
        let grid = Grid::new([5, 6, 7], [0.0; 3], 1.0).unwrap();
        let sampled = |value: &dyn Fn([f64; 3]) -> f64| grid.sampled::<f32>(value).data().to_vec();
        let plane = sampled(&|[x, y, z]| x + 2.0 * y - 3.0 * z);
        let smooth = smoothed(&grid, plane.clone());
        for point in 0..grid.point_count() {
            let place = grid.place(point);
            let is_inner = (0..3).all(|axis| (1..grid.shape()[axis] - 1).contains(&place[axis]));
            assert!(!is_inner || (smooth[point] - plane[point]).abs() < 1e-5);
        }
        let sheet = |thickness: f64| {
            let field = sampled(&|[x, ..]| (x - 2.0).abs() - 0.5 * thickness);
            smoothed(&grid, smoothed(&grid, field)).into_iter().any(|value| value < 0.0)
        };
        assert!(!sheet(0.5) && sheet(2.0));
    }

    proptest! {
        #[test]
        fn as_many_views_as_are_left_out_may_say_anything(
            distances in prop::collection::vec(-1.0..1.0_f64, 1..9),
            lies in prop::collection::vec(-9.0..9.0_f64, 0..4),
        ) {
            let largest = distances.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mut all = [distances.clone(), lies.clone()].concat();
            let views = all.len();
            let found = agreed(&mut all, views, lies.len()).unwrap();
            // Views that lie put places inside, never outside.
            prop_assert!(found <= largest);
            prop_assert!(lies.iter().any(|lie| *lie < largest) || found == largest);
            let mut said = distances.clone();
            prop_assert_eq!(agreed(&mut said, 2 * distances.len(), 0), Some(largest));
            prop_assert_eq!(agreed(&mut said, 2 * distances.len() + 1, 0), None);
            prop_assert_eq!(agreed(&mut said, 1, distances.len()), None);
        }
    }
}
