//! Charts: parts of a surface whose normals lie within a cone.
//!
//! All charts grow at once over shared edges, each from a seed face. The next face is the one with the least cost, the
//! sum of `(1.1 - n_face . axis) length` along the way. Then the mean of a chart's normals becomes its axis, and charts
//! grow anew from the faces at their middles, as in Lloyd's algorithm. Charts that fit within one cone are joined.
//!
//! # Source
//! Sander et al., *Multi-Chart Geometry Images*, SGP 2003, section 3; the cone is ours.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::{edges, repeats_a_vertex, sides};
use bokashi_render_ops::glam::DVec3;

use crate::placed::Placed;
use crate::triangle::{area_vector, quality};

/// Stands for no chart and for no neighbour.
pub(super) const NONE: u32 = u32::MAX;

/// Below this quality a face has no normal to speak of.
const DEGENERATE: f64 = 1e-12;

/// The number of rounds in which charts grow anew.
const ROUNDS: usize = 8;

/// Faces with their normals and neighbours.
pub(super) struct Faces {
    /// Unit normals; zero for a face without an area.
    pub(super) normals: Vec<DVec3>,
    middles: Vec<DVec3>,
    areas: Vec<f64>,
    /// The faces beyond the edges that face each corner, where two faces run through an edge in opposite directions.
    neighbors: Vec<[u32; 3]>,
}

/// The face from which a chart grows, and its axis.
#[derive(Clone, Copy)]
struct Seed {
    face: u32,
    axis: DVec3,
}

/// Faces, and the middle of the cone of their normals.
#[derive(Clone)]
pub(super) struct Chart {
    /// The faces, in the order in which the chart grew over them.
    pub(super) faces: Vec<u32>,
    pub(super) axis: DVec3,
}

/// A face over which a chart can grow next. The step with the least cost is the greatest, for the heap.
struct Step {
    cost: f64,
    face: u32,
    chart: u32,
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_cost = other.cost.total_cmp(&self.cost);
        by_cost.then(other.face.cmp(&self.face)).then(other.chart.cmp(&self.chart))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Step {}

impl Faces {
    pub(super) fn new(placed: &Placed, mesh: &Mesh) -> Self {
        let faces = mesh.faces();
        let mut all = Self {
            normals: Vec::with_capacity(faces.len()),
            middles: Vec::with_capacity(faces.len()),
            areas: Vec::with_capacity(faces.len()),
            neighbors: vec![[NONE; 3]; faces.len()],
        };
        for face in faces {
            let corners = placed.corners(*face);
            let is_flat = repeats_a_vertex(*face) || quality(corners) < DEGENERATE;
            let twice = if is_flat { DVec3::ZERO } else { area_vector(corners) };
            all.normals.push(twice.normalize_or_zero());
            all.areas.push(0.5 * twice.length());
            all.middles.push(corners.iter().sum::<DVec3>() / 3.0);
        }
        for edge in edges(&sides(faces)) {
            if let [one, other] = edge
                && one.rises != other.rises
            {
                all.neighbors[one.face as usize][usize::from(one.corner)] = other.face;
                all.neighbors[other.face as usize][usize::from(other.corner)] = one.face;
            }
        }
        all
    }

    /// Whether a face has an area.
    pub(super) fn is_proper(&self, face: u32) -> bool {
        self.normals[face as usize] != DVec3::ZERO
    }

    /// The area of all faces.
    pub(super) fn area(&self) -> f64 {
        self.areas.iter().sum()
    }

    /// Divides all faces with an area into charts. The cosine of a normal and its chart's axis is at least `least`.
    pub(super) fn charts(&self, least: f64) -> Vec<Chart> {
        let mut chart_of = vec![NONE; self.normals.len()];
        let mut charts = Vec::new();
        self.cover(&mut charts, &mut chart_of, least);
        for _ in 0..ROUNDS {
            let seeds: Vec<_> = charts.iter().map(|chart| self.seed_of(chart, least)).collect();
            chart_of.fill(NONE);
            charts = self.grown(&seeds, &mut chart_of, least);
            self.cover(&mut charts, &mut chart_of, least);
            self.join(&mut charts, &mut chart_of, least);
        }
        charts
    }

    /// Adds charts until each face with an area is in one.
    fn cover(&self, charts: &mut Vec<Chart>, chart_of: &mut [u32], least: f64) {
        for face in 0..self.normals.len() as u32 {
            if chart_of[face as usize] == NONE && self.is_proper(face) {
                let axis = self.axis_around(face, chart_of, least);
                let mut own = self.grown(&[Seed { face, axis }], chart_of, least);
                let number = charts.len() as u32;
                own.iter().flat_map(|chart| &chart.faces).for_each(|face| {
                    chart_of[*face as usize] = number;
                });
                charts.append(&mut own);
            }
        }
    }

    /// The mean normal of some 64 free faces around a face, or the face's normal where it is not within that cone.
    fn axis_around(&self, face: u32, chart_of: &[u32], least: f64) -> DVec3 {
        let normal = self.normals[face as usize];
        let (mut near, mut sum, mut next) = (vec![face], DVec3::ZERO, 0);
        while next < near.len() && near.len() < 64 {
            let at = near[next] as usize;
            sum += self.areas[at] * self.normals[at];
            for neighbor in self.neighbors[at].into_iter().filter(|face| *face != NONE) {
                let is_free = chart_of[neighbor as usize] == NONE && self.is_proper(neighbor);
                if is_free && !near.contains(&neighbor) {
                    near.push(neighbor);
                }
            }
            next += 1;
        }
        let axis = sum.normalize_or_zero();
        if axis.dot(normal) >= least { axis } else { normal }
    }

    /// The charts that grow from seeds over faces that are in no chart yet (Dijkstra's algorithm from all seeds at
    /// once).
    fn grown(&self, seeds: &[Seed], chart_of: &mut [u32], least: f64) -> Vec<Chart> {
        let mut charts: Vec<_> =
            seeds.iter().map(|seed| Chart { faces: Vec::new(), axis: seed.axis }).collect();
        let mut open: BinaryHeap<_> = (0..)
            .zip(seeds)
            .map(|(chart, seed)| Step { cost: 0.0, face: seed.face, chart })
            .collect();
        while let Some(Step { cost, face, chart }) = open.pop() {
            let at = face as usize;
            // A face is offered once by each neighbour, and taken at the least cost.
            if chart_of[at] != NONE {
                continue;
            }
            chart_of[at] = chart;
            let Chart { faces, axis } = &mut charts[chart as usize];
            faces.push(face);
            for neighbor in self.neighbors[at].into_iter().filter(|face| *face != NONE) {
                let next = neighbor as usize;
                let cosine = self.normals[next].dot(*axis);
                if chart_of[next] == NONE && self.is_proper(neighbor) && cosine >= least {
                    let length = self.middles[at].distance(self.middles[next]);
                    let cost = cost + (1.1 - cosine) * length;
                    open.push(Step { cost, face: neighbor, chart });
                }
            }
        }
        charts.retain(|chart| !chart.faces.is_empty());
        for (chart, number) in charts.iter().zip(0..) {
            chart.faces.iter().for_each(|face| chart_of[*face as usize] = number);
        }
        charts
    }

    /// The sum of the normals of faces, weighted by their areas.
    fn sum(&self, faces: &[u32]) -> DVec3 {
        faces.iter().map(|face| self.areas[*face as usize] * self.normals[*face as usize]).sum()
    }

    /// Whether the normals of all faces are within a cone.
    fn are_within(&self, faces: &[u32], axis: DVec3, least: f64) -> bool {
        faces.iter().all(|face| self.normals[*face as usize].dot(axis) >= least)
    }

    /// The face nearest to the middle of a chart, within the cone of the chart's mean normal.
    fn seed_of(&self, chart: &Chart, least: f64) -> Seed {
        let area: f64 = chart.faces.iter().map(|face| self.areas[*face as usize]).sum();
        let weighted = |face: &u32| self.areas[*face as usize] * self.middles[*face as usize];
        let middle = chart.faces.iter().map(weighted).sum::<DVec3>() / area;
        let axis = self.sum(&chart.faces).normalize_or_zero();
        let far = |face: &u32| {
            let distance = self.middles[*face as usize].distance_squared(middle);
            // Of faces at one distance, the one whose normal is nearest to the axis.
            (2.0 - self.normals[*face as usize].dot(axis)) * distance
        };
        let within = chart.faces.iter().filter(|face| self.are_within(&[**face], axis, least));
        match within.min_by(|one, other| far(one).total_cmp(&far(other))) {
            Some(&face) => Seed { face, axis },
            None => Seed { face: chart.faces[0], axis: self.normals[chart.faces[0] as usize] },
        }
    }

    /// Joins charts with neighbours, the smallest chart first, where all normals of both are within the cone of their
    /// mean. The neighbour with the longest common border is tried first. Faces of the smaller chart are tested first,
    /// so a large chart is seldom read.
    fn join(&self, charts: &mut Vec<Chart>, chart_of: &mut [u32], least: f64) {
        let mut order: Vec<usize> = (0..charts.len()).collect();
        order.sort_by_key(|&chart| (charts[chart].faces.len(), chart));
        let mut sums: Vec<_> = charts.iter().map(|chart| self.sum(&chart.faces)).collect();
        for chart in order {
            // Until it is put back or joined, the chart has no faces; `sums` always has the normals of all charts.
            let own = std::mem::take(&mut charts[chart].faces);
            let mut borders = BTreeMap::new();
            for &face in &own {
                for neighbor in self.neighbors[face as usize].into_iter().filter(|it| *it != NONE) {
                    let other = chart_of[neighbor as usize];
                    if other != NONE && other as usize != chart {
                        let length =
                            self.middles[face as usize].distance(self.middles[neighbor as usize]);
                        *borders.entry(other).or_insert(0.0) += length;
                    }
                }
            }
            let mut borders: Vec<(u32, f64)> = borders.into_iter().collect();
            borders.sort_by(|one, other| other.1.total_cmp(&one.1).then(one.0.cmp(&other.0)));
            let fits = |&(other, _): &(u32, f64)| {
                let sum = sums[other as usize] + sums[chart];
                let mut both = [&own, &charts[other as usize].faces];
                both.sort_by_key(|faces| faces.len());
                let axis = sum.normalize_or_zero();
                let are_within = both.iter().all(|faces| self.are_within(faces, axis, least));
                are_within.then_some((other as usize, sum))
            };
            let Some((other, sum)) = borders.iter().find_map(fits) else {
                charts[chart].faces = own;
                continue;
            };
            own.iter().for_each(|face| chart_of[*face as usize] = other as u32);
            charts[other].faces.extend(own);
            (charts[other].axis, sums[other]) = (sum.normalize_or_zero(), sum);
        }
        charts.retain(|chart| !chart.faces.is_empty());
        for (chart, number) in charts.iter().zip(0..) {
            chart.faces.iter().for_each(|face| chart_of[*face as usize] = number);
        }
    }

    /// Divides faces into groups that are connected over edges, by breadth-first search.
    pub(super) fn parts(&self, faces: &[u32]) -> Vec<Vec<u32>> {
        let mut is_open = vec![false; self.normals.len()];
        faces.iter().for_each(|face| is_open[*face as usize] = true);
        let mut parts = Vec::new();
        for &face in faces {
            if !std::mem::take(&mut is_open[face as usize]) {
                continue;
            }
            let (mut part, mut next) = (vec![face], 0);
            while let Some(&at) = part.get(next) {
                let neighbors = self.neighbors[at as usize].into_iter();
                for neighbor in neighbors.filter(|face| *face != NONE) {
                    if std::mem::take(&mut is_open[neighbor as usize]) {
                        part.push(neighbor);
                    }
                }
                next += 1;
            }
            parts.push(part);
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::sheet;

    /// The sheet's chart has ten thousand small neighbours, each of which is offered to it.
    #[test]
    fn thorns_that_a_sheet_is_too_flat_for_stay_charts_of_their_own() {
        let count = 160;
        let mut model = sheet(count);
        for (point, k) in model.points.iter_mut().zip(0..) {
            let [i, j] = [k / (count + 1), k % (count + 1)];
            let is_thorn = (i % 4, j % 4) == (2, 2);
            point.z = if is_thorn { 3.0 / count as f64 } else { 0.0 };
        }
        let (positions, mesh) = (model.positions(), model.mesh());
        let placed = Placed::new("charts", &positions, &mesh).unwrap();
        let charts = Faces::new(&placed, &mesh).charts(50_f64.to_radians().cos());
        let most = charts.iter().map(|chart| chart.faces.len()).max().unwrap();
        assert!(charts.len() > 4000 && most > 30_000, "{} {most}", charts.len());
        assert_eq!(charts.iter().map(|chart| chart.faces.len()).sum::<usize>(), mesh.faces().len());
    }
}
