//! A tree of boxes around points or triangles, in which the nearest is found without looking at all.
//!
//! Items are halved at the median of their centres, along the axis on which these lie furthest apart. Equal centres
//! follow their indices, so the tree depends on nothing but the items.

/// The most items of a leaf.
const LEAF: usize = 6;

/// The lowest and the highest coordinates of an item.
pub(super) type Extent = [[f64; 3]; 2];

#[derive(Debug)]
struct Node {
    extent: Extent,
    /// Where its items start, of a leaf; where its second child is, of another node. The first one is next to it.
    at: u32,
    /// How many items it has; 0 of a node with children.
    count: u32,
}

/// A tree over at least one item.
#[derive(Debug)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

fn union(a: Extent, b: Extent) -> Extent {
    let axes = [0, 1, 2];
    [axes.map(|axis| a[0][axis].min(b[0][axis])), axes.map(|axis| a[1][axis].max(b[1][axis]))]
}

/// The square of the distance to a box.
fn squared_distance([low, high]: &Extent, query: [f64; 3]) -> f64 {
    let gap = |axis: usize| (low[axis] - query[axis]).max(query[axis] - high[axis]).max(0.0);
    let gaps = [gap(0), gap(1), gap(2)];
    gaps[0] * gaps[0] + gaps[1] * gaps[1] + gaps[2] * gaps[2]
}

impl Tree {
    /// The tree over items with these boxes.
    pub(super) fn new(extents: &[Extent]) -> Self {
        let mut items: Vec<_> = (0..extents.len() as u32).collect();
        let mut nodes = Vec::with_capacity(extents.len());
        split(extents, &mut items, 0, &mut nodes);
        Self { nodes, items }
    }

    /// The item with the least `distance`, squared and from `query`, and this; of equal ones that with the lowest index.
    pub(super) fn nearest(&self, query: [f64; 3], distance: impl Fn(u32) -> f64) -> (u32, f64) {
        let (mut nearest, mut least) = (u32::MAX, f64::INFINITY);
        // As deep as there are halvings.
        let mut waiting = smallvec::SmallVec::<[(u32, f64); 32]>::new();
        waiting.push((0, 0.0));
        while let Some((at, away)) = waiting.pop() {
            if away > least {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count > 0 {
                for &item in &self.items[node.at as usize..][..node.count as usize] {
                    let found = distance(item);
                    if found < least || found == least && item < nearest {
                        (nearest, least) = (item, found);
                    }
                }
                continue;
            }
            let child = |at: u32| (at, squared_distance(&self.nodes[at as usize].extent, query));
            let [first, second] = [child(at + 1), child(node.at)];
            // The nearer one is looked at first.
            let children = if first.1 <= second.1 { [second, first] } else { [first, second] };
            waiting.extend(children);
        }
        (nearest, least)
    }
}

/// Adds the nodes over some items, of which the first is the item `start` of the tree.
fn split(extents: &[Extent], items: &mut [u32], start: usize, nodes: &mut Vec<Node>) {
    let extent = items.iter().map(|&item| extents[item as usize]).reduce(union);
    let Some(extent) = extent else { return };
    if items.len() <= LEAF {
        return nodes.push(Node { extent, at: start as u32, count: items.len() as u32 });
    }
    let center = |item: u32, axis: usize| {
        let [low, high] = extents[item as usize];
        low[axis] + high[axis]
    };
    let spread = |axis: usize| {
        let centers = items.iter().map(|&item| center(item, axis));
        let bounds = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = centers.fold(bounds, |(low, high), x| (low.min(x), high.max(x)));
        high - low
    };
    let spreads = [0, 1, 2].map(spread);
    let axis = (0..3).fold(0, |most, axis| if spreads[axis] > spreads[most] { axis } else { most });
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |&a, &b| {
        center(a, axis).total_cmp(&center(b, axis)).then(a.cmp(&b))
    });
    let here = nodes.len();
    nodes.push(Node { extent, at: 0, count: 0 });
    let (first, second) = items.split_at_mut(half);
    split(extents, first, start, nodes);
    nodes[here].at = nodes.len() as u32;
    split(extents, second, start + half, nodes);
}
