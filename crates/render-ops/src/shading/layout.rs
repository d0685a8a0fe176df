//! Which inputs of the operation are what, and which it refuses.

use bokashi_core::{Inputs, Scalar, Shape, TensorError};
use smallvec::SmallVec;

use super::blocks::{Column, MATERIAL, MOST_PARTS, NORMAL, POSITION, Rows, VIEW};
use super::lamp::{Kind, Lamp};
use crate::error::RenderError;

/// The operation's name.
pub(super) const NAME: &str = "shade";

/// An input that has rows, or one row for all.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub(super) input: usize,
    /// What it is, in the plural.
    pub(super) what: &'static str,
    /// The first of its numbers among those of a row, and how many there are.
    pub(super) first: usize,
    pub(super) width: usize,
}

/// Where a light's variables are in the inputs.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightInputs {
    pub(super) kind: Kind,
    pub(super) place: Option<usize>,
    pub(super) strength: usize,
}

/// The inputs: normals, views, positions where a light is a point, the parts of the material, and of
/// each light its place, if it has one, and its strength.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// What the numbers of the material are, and how many each part has.
    pub(super) material: &'static [(&'static str, usize)],
    pub(super) kinds: SmallVec<[Kind; 8]>,
}

/// Whether a part of such a shape has one row for all: `[3]` instead of `[N, 3]`, `[]` instead of `[N]`.
/// `None` for any other shape.
fn is_uniform(shape: &Shape, width: usize, count: usize) -> Option<bool> {
    match (width, &**shape) {
        (1, []) => Some(true),
        (1, &[n]) if n == count => Some(false),
        (2.., &[w]) if w == width => Some(true),
        (2.., &[n, w]) if n == count && w == width => Some(false),
        _ => None,
    }
}

impl Layout {
    pub(super) fn has_points(&self) -> bool {
        self.kinds.contains(&Kind::Point)
    }

    /// The parts of rows, in the order of the inputs.
    pub(super) fn parts(&self) -> SmallVec<[Part; MOST_PARTS]> {
        let mut parts = SmallVec::new();
        let mut add = |what, first, width| {
            let input = parts.len();
            parts.push(Part { input, what, first, width });
        };
        add("normals", NORMAL, 3);
        add("views", VIEW, 3);
        if self.has_points() {
            add("positions", POSITION, 3);
        }
        let mut first = MATERIAL;
        for &(what, width) in self.material {
            add(what, first, width);
            first += width;
        }
        parts
    }

    /// The variables of each light.
    pub(super) fn lights(&self) -> impl Iterator<Item = LightInputs> {
        let mut next = 2 + usize::from(self.has_points()) + self.material.len();
        let mut input = move || {
            next += 1;
            next - 1
        };
        self.kinds.iter().map(move |&kind| LightInputs {
            kind,
            place: kind.place().map(|_| input()),
            strength: input(),
        })
    }

    /// The numbers of all rows.
    pub(super) fn rows<'a, T: Scalar>(
        &self,
        count: usize,
        shape: impl Fn(usize) -> &'a Shape,
        data: impl Fn(usize) -> &'a [T],
    ) -> Rows<'a, T> {
        let column = |Part { input, what: _, first, width }: Part| Column {
            entries: data(input),
            first,
            width,
            is_uniform: is_uniform(shape(input), width, count) == Some(true),
        };
        Rows { columns: self.parts().into_iter().map(column).collect() }
    }

    pub(super) fn lamps<'a, T: Scalar>(
        &self,
        data: impl Fn(usize) -> &'a [T],
    ) -> SmallVec<[Lamp<T>; 8]> {
        let vector = |i: usize| *data(i).first_chunk().expect("it was checked");
        let lamp = |light: LightInputs| {
            Lamp::new(light.kind, light.place.map(vector), vector(light.strength))
        };
        self.lights().map(lamp).collect()
    }

    /// The number of rows.
    ///
    /// # Errors
    /// [`RenderError::Shape`], and `TensorError::Value` for a light. The numbers of rows are not looked
    /// at.
    pub(super) fn check<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<usize, RenderError> {
        let &[count, 3] = &**inputs.shape(0) else {
            return Err(RenderError::shape(NAME, "normals of shape [N, 3]", inputs.shape(0)));
        };
        for Part { input, what, first, width } in self.parts() {
            // Where each fragment has a place, each has a position and a normal of its own.
            let may_be_uniform = !matches!(first, NORMAL | POSITION);
            match is_uniform(inputs.shape(input), width, count) {
                Some(is_uniform) if may_be_uniform || !is_uniform => {}
                _ => {
                    let rule = match (may_be_uniform, width) {
                        (false, _) => format!("{what} of shape [{count}, {width}]"),
                        (true, 1) => format!("{what} of shape [{count}] or []"),
                        (true, _) => format!("{what} of shape [{count}, {width}] or [{width}]"),
                    };
                    return Err(RenderError::shape(NAME, rule, inputs.shape(input)));
                }
            }
        }
        for LightInputs { kind, place, strength } in self.lights() {
            if let (Some(input), Some(what)) = (place, kind.place()) {
                let entries = vector_of(inputs, input, what)?;
                if kind == Kind::Directional && entries.iter().all(|&entry| entry == T::ZERO) {
                    let rule = format!("{what} other than zero");
                    return Err(RenderError::value(NAME, rule, 0.0));
                }
            }
            let entries = vector_of(inputs, strength, kind.strength())?;
            if let Some(entry) = entries.iter().find(|&&entry| entry < T::ZERO) {
                let rule = format!("{} of 0 or more", kind.strength());
                return Err(RenderError::value(NAME, rule, entry.to_f64()));
            }
        }
        Ok(count)
    }

    /// The error of the first number of a row that has one.
    #[cold]
    pub(super) fn refuse<T: Scalar>(&self, rows: &Rows<'_, T>, lamps: &[Lamp<T>]) -> RenderError {
        for (Part { what, first, width, .. }, column) in self.parts().iter().zip(&rows.columns) {
            if let Some(index) = column.entries.iter().position(|entry| !entry.is_finite()) {
                let (row, value) = (index / width, column.entries[index].to_f64());
                return RenderError::NotFinite { operation: NAME, what, row, value };
            }
            let mut entries = column.entries.chunks(*width);
            let is_zero = |row: &[T]| row.iter().all(|&entry| entry == T::ZERO);
            if matches!(*first, NORMAL | VIEW)
                && let Some(row) = entries.position(is_zero)
            {
                return RenderError::Direction { operation: NAME, row };
            }
        }
        // What is left is a light that is too close.
        let positions = rows.columns.iter().find(|column| column.first == POSITION);
        let positions = positions.map_or(&[][..], |column| column.entries.as_chunks().0);
        let is_far = |&position: &[T; 3]| {
            let mut points = lamps.iter().filter(|lamp| lamp.kind == Kind::Point);
            points.all(|lamp| lamp.seen_from(position).2.is_finite())
        };
        let row = positions.iter().position(|position| !is_far(position)).unwrap_or_default();
        let what = "inverse squares of distances to a point light";
        RenderError::NotFinite { operation: NAME, what, row, value: f64::INFINITY }
    }
}

/// # Errors
/// [`RenderError::Shape`] unless the input is `[3]`; `TensorError::Value` unless it is finite.
fn vector_of<'a, T: Scalar>(
    inputs: &'a Inputs<'_, T>,
    input: usize,
    what: &str,
) -> Result<&'a [T], RenderError> {
    if **inputs.shape(input) != [3] {
        return Err(RenderError::shape(NAME, format!("{what} of shape [3]"), inputs.shape(input)));
    }
    let entries = inputs.data(input);
    match entries.iter().find(|entry| !entry.is_finite()) {
        None => Ok(entries),
        Some(entry) => {
            let rule = format!("{what} that is finite").into();
            let value = entry.to_f64();
            Err(TensorError::Value { operation: NAME, rule, value }.into())
        }
    }
}
