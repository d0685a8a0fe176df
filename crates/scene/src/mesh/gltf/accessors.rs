//! The numbers of accessors: typed rows of a buffer view, with some replaced where they are sparse.

use ::gltf::json::accessor::{Accessor, ComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, buffer};

use super::file::GltfFile;
use crate::error::SceneError;

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

    /// Whether the numbers are unsigned integers.
    fn is_unsigned(self) -> bool {
        matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
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

/// An accessor, and its number for messages.
#[derive(Debug, Clone, Copy)]
struct Numbered<'r> {
    accessor: &'r Accessor,
    number: usize,
}

impl Numbered<'_> {
    fn error(self, file: &GltfFile<'_, '_>, rule: impl std::fmt::Display) -> SceneError {
        file.error(format!("accessor {}: {rule}", self.number))
    }

    fn layout(self, file: &GltfFile<'_, '_>) -> Result<Layout, SceneError> {
        let (Checked::Valid(component), Checked::Valid(kind)) =
            (&self.accessor.component_type, &self.accessor.type_)
        else {
            return Err(self.error(file, "its types are those of the specification"));
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
                return Err(self.error(file, format!("{rule}, and these are {kind:?}")));
            }
        };
        Ok(Layout { component: component.0, width, normalized: self.accessor.normalized })
    }

    /// The layout of elements of so many unsigned integers.
    fn unsigned(
        self,
        width: usize,
        rule: &str,
        file: &GltfFile<'_, '_>,
    ) -> Result<Layout, SceneError> {
        let layout = self.layout(file)?;
        match layout.width == width && layout.is_unsigned() {
            true => Ok(layout),
            false => {
                let Layout { component, width, .. } = layout;
                Err(self.error(file, format!("{rule} {component:?} with {width} numbers")))
            }
        }
    }
}

impl<'r> GltfFile<'r, '_> {
    fn accessor(&self, index: Index<Accessor>) -> Result<Numbered<'r>, SceneError> {
        let (number, count) = (index.value(), self.root.accessors.len());
        match self.root.accessors.get(number) {
            Some(accessor) => Ok(Numbered { accessor, number }),
            None => {
                Err(self
                    .error(format!("the file has {count} accessors, and a mesh names {number}")))
            }
        }
    }

    /// The indices of an accessor.
    pub(super) fn indices(&mut self, index: Index<Accessor>) -> Result<Vec<u32>, SceneError> {
        let accessor = self.accessor(index)?;
        let layout = accessor.unsigned(1, "an index is an unsigned integer, and this is", self)?;
        self.elements(accessor, layout, 0, |bytes| layout.index(bytes))
    }

    /// Four numbers of joints for each vertex.
    pub(super) fn joints(&mut self, index: Index<Accessor>) -> Result<Vec<[u32; 4]>, SceneError> {
        let accessor = self.accessor(index)?;
        let layout =
            accessor.unsigned(4, "joints are four unsigned integers, and these are", self)?;
        let size = layout.component.size();
        let row = |bytes: &[u8]| [0, 1, 2, 3].map(|k| layout.index(&bytes[k * size..]));
        self.elements(accessor, layout, [0; 4], row)
    }

    /// The rows of an accessor, whose elements have so many numbers as `widths` says; those that an element
    /// does not have are 1. `is_fraction` says that integers are fractions, whatever the accessor says.
    pub(super) fn rows<const N: usize>(
        &mut self,
        index: Index<Accessor>,
        widths: &[usize],
        is_fraction: bool,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let accessor = self.accessor(index)?;
        let mut layout = accessor.layout(self)?;
        layout.normalized |= is_fraction;
        if !widths.contains(&layout.width) || layout.width > N {
            let rule =
                format!("an element has {widths:?} numbers, and these have {}", layout.width);
            return Err(accessor.error(self, rule));
        }
        let size = layout.component.size();
        self.elements(accessor, layout, [0.0; N], |bytes| {
            let mut row = [1.0; N];
            for (number, bytes) in row[..layout.width].iter_mut().zip(bytes.chunks_exact(size)) {
                *number = layout.number(bytes);
            }
            row
        })
    }

    /// What `row` makes of each element's bytes, and `zero` without a buffer view; some are replaced where the
    /// accessor is sparse.
    fn elements<R: Clone>(
        &mut self,
        numbered: Numbered<'r>,
        layout: Layout,
        zero: R,
        row: impl Fn(&[u8]) -> R,
    ) -> Result<Vec<R>, SceneError> {
        let Accessor { count, buffer_view, byte_offset, sparse, .. } = numbered.accessor;
        let all = count.0;
        if all >= u64::from(u32::MAX) {
            let rule = format!("there are fewer elements than 2^32 - 1, and this has {all}");
            return Err(numbered.error(self, rule));
        }
        // The rest is checked where the elements are read, but no memory is taken before.
        if let Some(view) = *buffer_view {
            let bytes = self.view(view)?.bytes().len();
            if all > bytes as u64 {
                let rule = format!("{all} elements lie in as many bytes or more, and here {bytes}");
                return Err(numbered.error(self, rule));
            }
        }
        self.spend(all, size_of::<R>())?;
        let mut rows = vec![zero; all as usize];
        if let Some(view) = *buffer_view {
            let start = (view, byte_offset.unwrap_or_default().0);
            self.each(numbered, start, layout, all, |k, bytes| rows[k] = row(bytes))?;
        }
        let Some(sparse) = sparse else { return Ok(rows) };
        let Checked::Valid(component) = sparse.indices.component_type else {
            return Err(numbered.error(self, "sparse indices are unsigned integers"));
        };
        let count = sparse.count.0;
        if count > all {
            let rule = format!("at most all {all} elements are replaced, and here are {count}");
            return Err(numbered.error(self, rule));
        }
        let index = Layout { component: component.0, width: 1, normalized: false };
        let start = (sparse.indices.buffer_view, sparse.indices.byte_offset.0);
        let mut replaced = Vec::new();
        self.each(numbered, start, index, count, |_, bytes| replaced.push(index.index(bytes)))?;
        if let Some(row) = replaced.iter().find(|&&row| u64::from(row) >= all) {
            let rule = format!("one of {all} elements is replaced, and this is number {row}");
            return Err(numbered.error(self, rule));
        }
        let start = (sparse.values.buffer_view, sparse.values.byte_offset.0);
        let replace = |k: usize, bytes: &[u8]| rows[replaced[k] as usize] = row(bytes);
        self.each(numbered, start, layout, count, replace)?;
        Ok(rows)
    }

    /// Gives each of `count` elements to `take`: those of a buffer view from an offset on.
    fn each(
        &mut self,
        numbered: Numbered<'r>,
        (view, offset): (Index<buffer::View>, u64),
        layout: Layout,
        count: u64,
        mut take: impl FnMut(usize, &[u8]),
    ) -> Result<(), SceneError> {
        if count == 0 {
            return Ok(());
        }
        let view = self.view(view)?;
        let (bytes, size) = (view.bytes(), layout.size() as u64);
        let stride = view.stride.map_or(size, |stride| stride as u64);
        if stride < size {
            let rule = format!("an element has {size} bytes, and the next begins after {stride}");
            return Err(numbered.error(self, rule));
        }
        let end = (count - 1).checked_mul(stride).and_then(|last| last.checked_add(size));
        let end = end.and_then(|length| length.checked_add(offset));
        if end.is_none_or(|end| end > bytes.len() as u64) {
            let message = format!("{count} elements of {stride} bytes from byte {offset} on");
            let rule = format!("elements lie in {} bytes of a view, and these are", bytes.len());
            return Err(numbered.error(self, format!("{rule} {message}")));
        }
        let (offset, stride, size) = (offset as usize, stride as usize, size as usize);
        for (k, element) in bytes[offset..].chunks(stride).take(count as usize).enumerate() {
            take(k, &element[..size]);
        }
        Ok(())
    }
}
