//! A field over a grid that is 0 on the surface of a hull.

use std::ops::RangeInclusive;

use bokashi_core::parallel::for_each_item_mut;
use bokashi_mesh::Grid;
use glam::DVec3;

/// Points along a side of a block.
const SIDE: usize = 8;
/// How many times faster than the distance in the world the field may change: perspective makes near things large.
const STEEPNESS: f64 = 2.0;

/// The largest of a point's distances from silhouettes, without the `left_out` share of the largest ones. Where it is below 0, the point is
/// inside for all other views; where fewer than half of all `views` say anything, it is `outside`.
pub(super) fn agreed(distances: &mut [f64], views: usize, left_out: f64, outside: f64) -> f64 {
    if 2 * distances.len() < views || distances.is_empty() {
        return outside;
    }
    let last = distances.len() - 1;
    // Two hundredths of 50 views are one of them, whatever rounding says.
    let skipped = ((left_out * distances.len() as f64 + 1e-9) as usize).min(last);
    *distances.select_nth_unstable_by(last - skipped, f64::total_cmp).1
}

/// The `field` at all points of the grid. Blocks of points that lie far from its surface have the number of the block's
/// middle: its sign is that of the field there.
pub(super) fn sampled(grid: &Grid, field: impl Fn(DVec3) -> f64 + Sync) -> Vec<f32> {
    let shape = grid.shape();
    let blocks = shape.map(|points| points.div_ceil(SIDE));
    let reach = STEEPNESS * 0.5 * 3.0_f64.sqrt() * SIDE as f64 * grid.spacing();
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
        let middle = field(0.5 * (low + high));
        if middle.abs() > reach {
            values.push(middle as f32);
            return;
        }
        for i in x {
            for j in y.clone() {
                values.extend(z.clone().map(|k| field(position([i, j, k])) as f32));
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
