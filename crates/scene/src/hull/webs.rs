//! Webs of a hull: thin parts that no silhouette needs.
//!
//! Views may look through a hole along lines that cross. No silhouette shows that nothing is between the lines, so a
//! hull has bars across both mouths: three holes where the object has one.
//!
//! # Formula
//! The surface moves by its mean curvature, but only inward. A step takes means over neighbours of the indicator of the
//! inside. Points whose mean is below a half are removed. A point stays if a view would lose a block of pixels without
//! it, so the images of the hull keep all their blocks.
//!
//! # Source
//! Merriman, Bence and Osher, *Diffusion generated motion by mean curvature*, 1992.

use bokashi_core::parallel::for_each_item_mut;
use bokashi_mesh::Grid;
use glam::DVec3;

use super::field::smoothed;
use super::silhouette::Blocks;

/// Passes of smoothing in a step: a Gaussian of 1.4 cells. Bars of some four cells vanish.
const SMOOTHINGS: usize = 4;
/// The number of steps: fewer leave bars.
const STEPS: usize = 10;

/// Finds the webs of a hull: 1 at the points of a grid around `middle` that are webs, and 0 elsewhere. The hull is
/// inside where `values` are below 0, and `views` see it in blocks of pixels. `None` without webs.
pub(super) fn find_webs(
    grid: &Grid,
    values: &[f32],
    middle: DVec3,
    views: &[Blocks],
) -> Option<Vec<f32>> {
    let is_inside = |value: &f32| *value < 0.0;
    let mut inside: Vec<_> = values.iter().map(|it| f32::from(u8::from(is_inside(it)))).collect();
    let mut webs = None;
    for _ in 0..STEPS {
        let mean = (0..SMOOTHINGS).fold(inside.clone(), |mean, _| smoothed(grid, mean));
        let all = (0..inside.len()).filter(|&point| inside[point] > 0.5);
        let (stay, go): (Vec<_>, Vec<_>) = all.partition(|&point| mean[point] >= 0.5);
        let place = |point: usize| middle + DVec3::from(grid.position(point));
        let mut needed = vec![Vec::new(); views.len()];
        for_each_item_mut(&mut needed, |view, needed| {
            let blocks = &views[view];
            let mut is_covered = vec![false; blocks.count()];
            let block = blocks.finder();
            for block in stay.iter().filter_map(|&point| block(place(point))) {
                is_covered[block] = true;
            }
            let is_bare = |point: &usize| block(place(*point)).is_some_and(|it| !is_covered[it]);
            *needed = go.iter().map(is_bare).collect();
        });
        let gone = (0..go.len()).filter(|&k| !needed.iter().any(|needed| needed[k]));
        let gone: Vec<_> = gone.map(|k| go[k]).collect();
        if gone.is_empty() {
            break;
        }
        let webs = webs.get_or_insert_with(|| vec![0.0; inside.len()]);
        for point in gone {
            (inside[point], webs[point]) = (0.0, 1.0);
        }
    }
    webs
}

/// The field without webs of a rougher grid. A point is outside where the interpolated share of webs is above a half.
pub(super) fn values_without(webs: &[f32], rough: &Grid, grid: &Grid, values: &[f32]) -> Vec<f32> {
    let value = |(point, &value): (usize, &f32)| {
        let share = between(rough, webs, DVec3::from(grid.position(point)));
        if share > 0.0 { value.max(((share - 0.5) * rough.spacing()) as f32) } else { value }
    };
    values.iter().enumerate().map(value).collect()
}

/// The value at a place inside a grid, by trilinear interpolation.
fn between(grid: &Grid, values: &[f32], place: DVec3) -> f64 {
    let shape = grid.shape();
    let last = DVec3::from(shape.map(|points| (points - 1) as f64));
    let cell = (place - DVec3::from(grid.origin())) / grid.spacing();
    let cell = cell.clamp(DVec3::ZERO, last);
    let low = cell.floor().min(last - 1.0);
    let share = cell - low;
    let [i, j, k] = low.to_array().map(|x| x as usize);
    let corner = |corner: usize| {
        let step = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        let weight = |axis: usize| if step[axis] == 1 { share[axis] } else { 1.0 - share[axis] };
        let point = ((i + step[0]) * shape[1] + j + step[1]) * shape[2] + k + step[2];
        weight(0) * weight(1) * weight(2) * f64::from(values[point])
    };
    (0..8).map(corner).sum()
}

#[cfg(test)]
mod tests {
    use bokashi_core::Tensor;
    use bokashi_render_ops::Size;
    use glam::DMat4;

    use super::super::silhouette::Silhouette;
    use super::super::{parts_and_handles, surface_of};
    use super::*;
    use crate::cameras::Camera;

    /// The blocks of a view that looks at the origin from 4 along an axis; the object is all that it sees.
    fn view(grid: &Grid, turn: DMat4) -> Blocks {
        let view = DMat4::from_translation(4.0 * DVec3::Z) * turn;
        let size = Size { width: 64, height: 64 };
        let camera = Camera { view, ..Camera::new(size, [80.0, 80.0, 31.5, 31.5]) };
        let mask = Tensor::from_flat_fn([64, 64], |_| 1.0);
        Silhouette::new(camera, &mask).blocks(DVec3::ZERO, grid.spacing())
    }

    fn handles_of(grid: &Grid, values: &[f32]) -> i64 {
        parts_and_handles(&surface_of(grid, values.to_vec()).unwrap().unwrap().1)[1]
    }

    #[test]
    fn bars_across_the_mouths_of_a_hole_are_webs() {
        let grid = Grid::around([-0.8; 3], [0.8; 3], 64).unwrap();
        // A block, and two tunnels through it that cross in its middle.
        let tunnel = |p: DVec3, slope: f64| (p.x - slope * p.z).hypot(p.y) - 0.18;
        let block = |p: DVec3| (p.abs() - DVec3::new(0.75, 0.75, 0.6)).max_element();
        let field = |p: DVec3| block(p).max(-tunnel(p, 0.36)).max(-tunnel(p, -0.36));
        let values = grid.sampled::<f32>(|p| field(DVec3::from(p)));
        let views = [DMat4::from_rotation_y(1.0), DMat4::from_rotation_x(1.0)]
            .map(|turn| view(&grid, turn));
        let webs = find_webs(&grid, values.data(), DVec3::ZERO, &views).unwrap();
        let cleared = values_without(&webs, &grid, &grid, values.data());
        assert_eq!([handles_of(&grid, values.data()), handles_of(&grid, &cleared)], [3, 1]);
        // Edges become rounder by some cells, and nothing else goes.
        for (point, web) in webs.iter().enumerate().filter(|(_, web)| **web > 0.0) {
            let place = DVec3::from(grid.position(point));
            let is_bar = place.x.abs() < 0.15 && place.y.abs() < 0.25;
            assert!(is_bar || field(place) > -0.15, "{web} at {place}");
        }
    }

    #[test]
    fn a_sheet_stays_where_a_view_needs_it() {
        let grid = Grid::around([-0.6; 3], [0.6; 3], 32).unwrap();
        let sheet = |[x, y, z]: [f64; 3]| (x.abs() - 0.03).max(y.abs() - 0.5).max(z.abs() - 0.5);
        let values = grid.sampled::<f32>(sheet);
        let found = |views: &[Blocks]| find_webs(&grid, values.data(), DVec3::ZERO, views);
        let all = values.data().iter().filter(|value| **value < 0.0).count();
        assert!(all > 0);
        let gone = |webs: Option<Vec<f32>>| webs.map_or(0.0, |webs| webs.iter().sum()) as usize;
        assert_eq!(gone(found(&[])), all);
        let across = DMat4::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let kept = all - gone(found(&[view(&grid, across)]));
        assert!(2 * kept > all, "{kept} of {all}");
    }

    #[test]
    fn values_of_a_rougher_grid_are_linear_between_its_points() {
        let grid = Grid::new([3, 4, 5], [0.5, -1.0, 2.0], 0.25).unwrap();
        let plane = |p: DVec3| p.dot(DVec3::new(1.0, -2.0, 3.0)) + 0.5;
        let values = grid.sampled::<f32>(|p| plane(DVec3::from(p)));
        for share in [DVec3::ZERO, DVec3::ONE, DVec3::new(0.3, 0.9, 0.55)] {
            let place = DVec3::from(grid.origin()) + share * 0.25 * DVec3::new(2.0, 3.0, 4.0);
            assert!((between(&grid, values.data(), place) - plane(place)).abs() < 1e-5);
        }
    }
}
