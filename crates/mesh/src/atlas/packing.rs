//! Charts side by side in a square.
//!
//! The highest charts come first. Each is dropped on the horizon of those before, at the place where it lies lowest,
//! and leftmost of such places. A bisection finds the largest scale at which all charts have room.
//!
//! # Source
//! Lévy et al., *Least Squares Conformal Maps for Automatic Texture Atlas Generation*, SIGGRAPH 2002, section 4.

use bokashi_render_ops::glam::DVec2;

use super::flat::FlatChart;

/// The most columns of a horizon: more cost time and gain little room.
const COLUMNS: usize = 512;
/// The number of steps of the bisection.
const HALVINGS: usize = 12;

/// Where charts lie in a texture.
pub(super) struct Packing {
    /// The number of texels per unit of the charts.
    pub(super) scale: f64,
    /// The place of each chart's least coordinates, in texels.
    pub(super) corners: Vec<DVec2>,
}

/// The horizons of a chart: its lowest and its highest blocks, per column.
struct Horizons {
    bottom: Vec<usize>,
    top: Vec<usize>,
    height: usize,
}

impl Packing {
    /// The share of the texture that charts cover.
    pub(super) fn covered(&self, charts: &[FlatChart], size: usize) -> f64 {
        let scale = self.scale / size as f64;
        charts.iter().map(FlatChart::area).sum::<f64>() * scale * scale
    }
}

/// Packs charts into a texture of `size` by `size` texels. Each chart has a gutter of `reach` texels. `None` where the
/// texture has no room for them.
pub(super) fn packed(charts: &[FlatChart], size: usize, reach: f64) -> Option<Packing> {
    // In blocks, so that the work does not grow with the texture.
    let block = size.div_ceil(COLUMNS);
    let blocks = size / block;
    let at = |scale: f64| {
        let horizons: Vec<_> =
            charts.iter().map(|it| Horizons::new(it, scale, reach, block)).collect();
        let places = placed(&horizons, blocks)?;
        let corner = |place: [usize; 2]| {
            DVec2::from_array(place.map(|place| (place * block) as f64)) + reach
        };
        Some(Packing { scale, corners: places.into_iter().map(corner).collect() })
    };
    if charts.is_empty() {
        return at(f64::INFINITY);
    }
    // The scale is bounded: charts cover at most the whole texture, and the longest fits in with its gutters.
    let area: f64 = charts.iter().map(FlatChart::area).sum();
    let longest = charts.iter().fold(0.0, |most: f64, chart| most.max(chart.extent.max_element()));
    let most = (size as f64 / area.sqrt()).min((size as f64 - 2.0 * reach) / longest);
    if !most.is_finite() || most <= 0.0 {
        return None;
    }
    let mut best = None;
    let (mut low, mut high) = (0.0, most);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match at(middle) {
            Some(found) => (best, low) = (Some(found), middle),
            None => high = middle,
        }
    }
    best
}

impl Horizons {
    fn new(chart: &FlatChart, scale: f64, reach: f64, block: usize) -> Self {
        let blocks = |texels: f64| texels / block as f64;
        let extent = (chart.extent * scale + 2.0 * reach) / block as f64;
        let [width, height] = [extent.x, extent.y].map(|length| (length.ceil() as usize).max(1));
        let (mut bottom, mut top) = (vec![height; width], vec![0; width]);
        for face in &chart.corners {
            let corners = face.map(|vertex| chart.points[vertex as usize] * scale);
            let low = corners.into_iter().fold(DVec2::INFINITY, DVec2::min);
            let high = corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max) + 2.0 * reach;
            let last = (blocks(high.x).ceil() as usize).clamp(1, width);
            let first = (blocks(low.x) as usize).min(last - 1);
            let (lowest, highest) =
                (blocks(low.y) as usize, (blocks(high.y).ceil() as usize).min(height));
            for column in first..last {
                bottom[column] = bottom[column].min(lowest);
                top[column] = top[column].max(highest);
            }
        }
        Self { bottom, top, height }
    }
}

/// Where charts lie in a square of so many blocks, in their order; `None` where it has no room for them.
fn placed(charts: &[Horizons], blocks: usize) -> Option<Vec<[usize; 2]>> {
    let mut order: Vec<usize> = (0..charts.len()).collect();
    order.sort_by_key(|&k| (std::cmp::Reverse(charts[k].height), k));
    // The horizon of all charts so far.
    let mut horizon = vec![0; blocks];
    let mut places = vec![[0; 2]; charts.len()];
    for k in order {
        let Horizons { bottom, top, height } = &charts[k];
        // In each column `y + bottom >= horizon`, so y is the largest difference.
        let lowest = |x: usize| {
            let rise = horizon[x..]
                .iter()
                .zip(bottom)
                .map(|(horizon, bottom): (&usize, _)| horizon.saturating_sub(*bottom));
            rise.max().unwrap_or(0)
        };
        let columns = 0..(blocks + 1).checked_sub(bottom.len())?;
        let (y, x) = columns.map(|x| (lowest(x), x)).min()?;
        if y + height > blocks {
            return None;
        }
        for (horizon, top) in horizon[x..].iter_mut().zip(top) {
            // A column that the chart leaves out stays as it is.
            *horizon = (*horizon).max(if *top > 0 { y + top } else { 0 });
        }
        places[k] = [x, y];
    }
    Some(places)
}
