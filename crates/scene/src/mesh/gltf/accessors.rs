//! The numbers of accessors: typed rows of a buffer view, with some replaced where they are sparse.

use ::gltf::json::accessor::{Accessor, ComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root, buffer};

use super::buffers::Buffers;
use crate::error::SceneError;
use crate::mesh::context::MeshContext;

/// How an accessor's elements lie in bytes.
#[derive(Debug, Clone, Copy)]
struct Layout {
    component: ComponentType,
    /// Numbers of an element.
    width: usize,
    /// Whether integers stand for fractions of the largest.
    normalized: bool,
}

impl Layout {
    /// Bytes of an element.
    fn size(self) -> usize {
        self.width * self.component.size()
    }

    /// The number of an element that these bytes begin with. Integers of 32 bits are rounded.
    fn number(self, bytes: &[u8]) -> f32 {
        let (number, largest) = match self.component {
            ComponentType::F32 => return f32::from_le_bytes(first(bytes)),
            ComponentType::I8 => (f32::from(i8::from_le_bytes(first(bytes))), 127.0),
            ComponentType::U8 => (f32::from(bytes[0]), 255.0),
            ComponentType::I16 => (f32::from(i16::from_le_bytes(first(bytes))), 32767.0),
            ComponentType::U16 => (f32::from(u16::from_le_bytes(first(bytes))), 65535.0),
            ComponentType::U32 => (u32::from_le_bytes(first(bytes)) as f32, u32::MAX as f32),
        };
        match self.normalized {
            // The least integer of a signed type is below -1.
            true => (number / largest).max(-1.0),
            false => number,
        }
    }

    /// The index that these bytes begin with.
    fn index(self, bytes: &[u8]) -> u32 {
        match self.component {
            ComponentType::U8 => u32::from(bytes[0]),
            ComponentType::U16 => u32::from(u16::from_le_bytes(first(bytes))),
            _ => u32::from_le_bytes(first(bytes)),
        }
    }
}

/// The first bytes: the layout was checked against how many there are.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.first_chunk().copied().unwrap_or([0; N])
}

/// An accessor of a file, for messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct Named<'r> {
    pub(super) accessor: &'r Accessor,
    pub(super) number: usize,
}

impl<'r> Named<'r> {
    pub(super) fn of(
        root: &'r Root,
        index: Index<Accessor>,
        context: &MeshContext<'_>,
    ) -> Result<Self, SceneError> {
        let number = index.value();
        let accessor = root.accessors.get(number).ok_or_else(|| {
            let count = root.accessors.len();
            let found = format!("the file has {count} accessors, and a mesh names {number}");
            SceneError::content(context.place(), found)
        })?;
        Ok(Self { accessor, number })
    }

    fn refused(self, context: &MeshContext<'_>, rule: impl std::fmt::Display) -> SceneError {
        SceneError::content(context.place(), format!("accessor {}: {rule}", self.number))
    }

    fn layout(self, context: &MeshContext<'_>) -> Result<Layout, SceneError> {
        let (Checked::Valid(component), Checked::Valid(kind)) =
            (&self.accessor.component_type, &self.accessor.type_)
        else {
            return Err(self.refused(context, "its types are those of the specification"));
        };
        let width = match kind {
            Type::Scalar => 1,
            Type::Vec2 => 2,
            Type::Vec3 => 3,
            Type::Vec4 => 4,
            Type::Mat4 => 16,
            // Their columns may have bytes between them.
            Type::Mat2 | Type::Mat3 => {
                let rule = "an element has up to four numbers, or is a matrix of 4 x 4";
                return Err(self.refused(context, format!("{rule}, and these are {kind:?}")));
            }
        };
        Ok(Layout { component: component.0, width, normalized: self.accessor.normalized })
    }

    /// The indices of an accessor.
    pub(super) fn indices(
        self,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Vec<u32>, SceneError> {
        let layout = self.layout(context)?;
        let unsigned = [ComponentType::U8, ComponentType::U16, ComponentType::U32];
        if layout.width != 1 || !unsigned.contains(&layout.component) {
            let found = format!("{:?} with {} numbers", layout.component, layout.width);
            let rule = format!("an index is an unsigned integer, and this is {found}");
            return Err(self.refused(context, rule));
        }
        let mut indices = self.zeros(0_u32, buffers, context)?;
        self.dense(layout, buffers, context, |row, bytes| indices[row] = layout.index(bytes))?;
        self.sparse(layout, buffers, context, |row, bytes| indices[row] = layout.index(bytes))?;
        Ok(indices)
    }

    /// Four numbers of joints for each vertex.
    pub(super) fn joints(
        self,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Vec<[u32; 4]>, SceneError> {
        let layout = self.layout(context)?;
        let unsigned = [ComponentType::U8, ComponentType::U16, ComponentType::U32];
        if layout.width != 4 || !unsigned.contains(&layout.component) {
            let found = format!("{:?} with {} numbers", layout.component, layout.width);
            let rule = format!("joints are four unsigned integers, and these are {found}");
            return Err(self.refused(context, rule));
        }
        let mut rows = self.zeros([0; 4], buffers, context)?;
        let size = layout.component.size();
        let row_of = |bytes: &[u8]| [0, 1, 2, 3].map(|k| layout.index(&bytes[k * size..]));
        self.dense(layout, buffers, context, |row, bytes| rows[row] = row_of(bytes))?;
        self.sparse(layout, buffers, context, |row, bytes| rows[row] = row_of(bytes))?;
        Ok(rows)
    }

    /// The rows of an accessor, whose elements have so many numbers as `widths` says; those that an element
    /// does not have are 1. `is_fraction` says that integers are fractions, whatever the accessor says.
    pub(super) fn rows<const N: usize>(
        self,
        widths: &[usize],
        is_fraction: bool,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let mut layout = self.layout(context)?;
        layout.normalized |= is_fraction;
        if !widths.contains(&layout.width) || layout.width > N {
            let rule =
                format!("an element has {widths:?} numbers, and these have {}", layout.width);
            return Err(self.refused(context, rule));
        }
        let mut rows = self.zeros([0.0; N], buffers, context)?;
        let size = layout.component.size();
        let row_of = |bytes: &[u8]| {
            let mut row = [1.0; N];
            for (number, bytes) in row[..layout.width].iter_mut().zip(bytes.chunks_exact(size)) {
                *number = layout.number(bytes);
            }
            row
        };
        self.dense(layout, buffers, context, |row, bytes| rows[row] = row_of(bytes))?;
        self.sparse(layout, buffers, context, |row, bytes| rows[row] = row_of(bytes))?;
        Ok(rows)
    }

    /// As many `zero` as the accessor has elements, where memory for so many is allowed.
    fn zeros<R: Clone>(
        self,
        zero: R,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
    ) -> Result<Vec<R>, SceneError> {
        let count = self.accessor.count.0;
        if count >= u64::from(u32::MAX) {
            let rule = format!("there are fewer elements than 2^32 - 1, and this has {count}");
            return Err(self.refused(context, rule));
        }
        // The rest is checked where the elements are read, but no memory is taken before.
        if let Some(view) = self.accessor.buffer_view {
            let bytes = buffers.view(view, context)?.bytes().len();
            if count > bytes as u64 {
                let rule =
                    format!("{count} elements lie in as many bytes or more, and here {bytes}");
                return Err(self.refused(context, rule));
            }
        }
        buffers.budget.spend(count, size_of::<R>(), &context.place())?;
        Ok(vec![zero; count as usize])
    }

    /// Gives each element of the accessor's buffer view to `take`, with its number.
    fn dense(
        self,
        layout: Layout,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
        take: impl FnMut(usize, &[u8]),
    ) -> Result<(), SceneError> {
        let Some(view) = self.accessor.buffer_view else { return Ok(()) };
        let offset = self.accessor.byte_offset.unwrap_or_default().0;
        self.elements((view, offset), layout, self.accessor.count.0, (buffers, context), take)
    }

    /// Gives each replaced element to `take`, with the number of the element in whose place it stands.
    fn sparse(
        self,
        layout: Layout,
        buffers: &mut Buffers<'_>,
        context: &MeshContext<'_>,
        mut take: impl FnMut(usize, &[u8]),
    ) -> Result<(), SceneError> {
        let Some(sparse) = &self.accessor.sparse else { return Ok(()) };
        let Checked::Valid(component) = sparse.indices.component_type else {
            return Err(self.refused(context, "sparse indices are unsigned integers"));
        };
        let (count, all) = (sparse.count.0, self.accessor.count.0);
        if count > all {
            let rule = format!("at most all {all} elements are replaced, and here are {count}");
            return Err(self.refused(context, rule));
        }
        let of_index = Layout { component: component.0, width: 1, normalized: false };
        let (indices, values) = (&sparse.indices, &sparse.values);
        let from = (indices.buffer_view, indices.byte_offset.0);
        let mut rows = Vec::new();
        self.elements(from, of_index, count, (&mut *buffers, context), |_, bytes| {
            rows.push(of_index.index(bytes));
        })?;
        if let Some(row) = rows.iter().find(|&&row| u64::from(row) >= all) {
            let rule = format!("one of {all} elements is replaced, and this is number {row}");
            return Err(self.refused(context, rule));
        }
        let from = (values.buffer_view, values.byte_offset.0);
        self.elements(from, layout, count, (buffers, context), |k, bytes| {
            take(rows[k] as usize, bytes);
        })
    }

    /// Gives each of `count` elements to `take`: those of a buffer view from an offset on.
    fn elements(
        self,
        (view, offset): (Index<buffer::View>, u64),
        layout: Layout,
        count: u64,
        (buffers, context): (&mut Buffers<'_>, &MeshContext<'_>),
        mut take: impl FnMut(usize, &[u8]),
    ) -> Result<(), SceneError> {
        if count == 0 {
            return Ok(());
        }
        let view = buffers.view(view, context)?;
        let (bytes, size) = (view.bytes(), layout.size() as u64);
        let stride = view.stride.map_or(size, |stride| stride as u64);
        if stride < size {
            let rule = format!("an element has {size} bytes, and the next begins after {stride}");
            return Err(self.refused(context, rule));
        }
        let end = (count - 1).checked_mul(stride).and_then(|last| last.checked_add(size));
        let end = end.and_then(|length| length.checked_add(offset));
        if end.is_none_or(|end| end > bytes.len() as u64) {
            let found = format!("{count} elements of {stride} bytes from byte {offset} on");
            let rule = format!("elements lie in {} bytes of a view, and these are", bytes.len());
            return Err(self.refused(context, format!("{rule} {found}")));
        }
        let (offset, stride, size) = (offset as usize, stride as usize, size as usize);
        for (k, element) in bytes[offset..].chunks(stride).take(count as usize).enumerate() {
            take(k, &element[..size]);
        }
        Ok(())
    }
}
