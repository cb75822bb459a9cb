//! What an argument is about: tensors of integers that were committed to, and relations between them.
//!
//! Everything here is fixed by the statement and known to both sides. A relation never names single values. It names *tensors*, whose
//! values have an index on each of their axes, and states what holds for all indices:
//!
//! - a [`Virtual`] is a tensor that nobody commits to, because each of its values is one of another tensor;
//! - a [`Product`] is a tensor of sums of products of two others, as a matrix product is;
//! - a [`Monomials`] is a tensor of sums of products of values at the same index;
//! - a [`Lookup`] states that each entry of a tensor is a row of a table; an [`Equality`] states that each value of a tensor is zero.

pub mod along;
mod axis;
mod part;
pub mod public;

pub use axis::Axis;
pub use part::{Part, PartId, Parts};

use crate::field::Goldilocks;
use alloc::boxed::Box;
use alloc::vec::Vec;
use public::Public;

/// What a tensor's values are taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ColumnSource(pub u8);

/// Where the index on an axis of a tensor stands in the number of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct AxisPlace {
    /// The index is shifted left by so many bits.
    pub shift: u8,
    /// Bits of the index.
    pub bits: u8,
}

/// A part of a source: the values whose numbers are `offset` plus the shifted indices. The offset is zero where an index stands.
#[derive(Clone, Debug)]
pub struct Tensor {
    /// Names it in errors.
    pub name: &'static str,
    /// Where its values are.
    pub source: ColumnSource,
    /// Number of its first value there.
    pub offset: usize,
    /// Where the index on each of its axes stands.
    pub places: Vec<AxisPlace>,
}

impl Tensor {
    /// The number of the value with these indices.
    pub fn number(&self, indices: &[usize]) -> usize {
        let shifted = self
            .places
            .iter()
            .zip(indices)
            .map(|(place, index)| index << place.shift);
        self.offset + shifted.sum::<usize>()
    }

    /// A tensor whose values lie in one piece, with axes of so many bits, from the one whose index changes fastest.
    pub fn packed(name: &'static str, source: ColumnSource, offset: usize, axes: &[u8]) -> Self {
        let mut shift = 0;
        let places = axes.iter().map(|&bits| {
            let place = AxisPlace { shift, bits };
            shift += bits;
            place
        });
        Self {
            name,
            source,
            offset,
            places: places.collect(),
        }
    }
}

/// A tensor that is committed to, and its own view.
#[derive(Clone, Copy, Debug)]
pub struct Committed {
    /// Number in [`Relations::tensors`].
    pub tensor: usize,
    /// Number in [`Relations::virtuals`].
    pub view: usize,
}

impl Committed {
    /// Its values.
    pub fn atom(self) -> Atom {
        Atom::Virtual(self.view)
    }
}

/// Where the index on an axis of a tensor comes from.
#[derive(Clone, Copy, Debug)]
pub enum Index {
    /// It is the index on this axis.
    Of(Axis),
    /// It follows from the index on this axis by the map with this number in [`Relations::maps`].
    Mapped(Axis, usize),
    /// It is always this one.
    Fixed(usize),
}

/// A tensor seen with other axes.
#[derive(Clone, Debug)]
pub struct View {
    /// Number in [`Relations::tensors`].
    pub tensor: usize,
    /// One for each axis of the tensor.
    pub indices: Vec<Index>,
    /// The view is zero unless the index on this axis is this one.
    pub only: Vec<(Axis, usize)>,
    /// What its values are multiplied with.
    pub factor: i64,
}

/// A sum of views, which depends on some axes. Along axes that a view does not read, its values repeat.
#[derive(Clone, Debug)]
pub struct Virtual {
    /// The views.
    pub views: Vec<View>,
}

/// `P = Σ_summed left·right`.
#[derive(Clone, Debug)]
pub struct Product {
    /// Number in [`Relations::virtuals`].
    pub left: usize,
    /// Likewise.
    pub right: usize,
    /// Axes of the product that only the left factor has.
    pub left_axes: Vec<Axis>,
    /// Axes of the product that only the right factor has.
    pub right_axes: Vec<Axis>,
    /// Axes of the product that both factors have.
    pub shared: Vec<Axis>,
    /// Axes of both factors that the product does not have.
    pub summed: Vec<Axis>,
}

/// A factor of a monomial: numbers in the lists of [`Relations`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Factor {
    /// A value of a virtual tensor.
    Virtual(usize),
    /// A value of a product.
    Product(usize),
    /// A value that both sides compute.
    Public(usize),
}

/// `Σ coefficient · Π factors` at each index.
#[derive(Clone, Debug)]
pub struct Monomials {
    /// Its axes, from the lowest.
    pub axes: Vec<Axis>,
    /// The index on these axes is summed over. They are the last of `axes`.
    pub summed: usize,
    /// Coefficients and factors, of which there are up to [`MAX_FACTORS`].
    pub terms: Vec<(i64, Vec<Factor>)>,
}

/// Most factors of a monomial.
pub const MAX_FACTORS: usize = 3;

/// Sums of the values of a virtual tensor over some of its axes.
#[derive(Clone, Debug)]
pub struct Summed {
    /// Number in [`Relations::virtuals`].
    pub of: usize,
    /// The axes that are summed over.
    pub axes: Vec<Axis>,
}

/// What a term of a [`LinearSum`] multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Atom {
    /// 1.
    One,
    /// A value of a virtual tensor.
    Virtual(usize),
    /// A value of a product.
    Product(usize),
    /// A value of monomials.
    Monomials(usize),
    /// A sum of values.
    Summed(usize),
    /// A value that both sides compute.
    Public(usize),
}

/// `factor · coefficients[index on its axis] · atom`.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// The same everywhere.
    pub factor: i64,
    /// Number in [`Relations::coefficients`].
    pub coefficients: Option<usize>,
    /// What is multiplied.
    pub atom: Atom,
}

/// A sum of terms.
pub type LinearSum = Vec<Term>;

/// Columns of a table.
pub const COLUMNS: usize = 4;

/// Whether entries are looked up or offered.
#[derive(Clone, Copy, Debug)]
pub enum Count {
    /// Every entry is looked up.
    Each,
    /// An entry is looked up where a public value is 1, and not where it is 0.
    Masked(usize),
    /// The entries are a table's rows. A virtual tensor states how often each is looked up.
    Offered(usize),
}

/// Entries of [`COLUMNS`] values: what is looked up, or a table. All tables share one sum, so a column has to tell them apart.
#[derive(Clone, Debug)]
pub struct Lookup {
    /// Names it in errors.
    pub name: &'static str,
    /// Its axes, from the lowest.
    pub axes: Vec<Axis>,
    /// Which entries count.
    pub count: Count,
    /// The columns of an entry.
    pub entry: [LinearSum; COLUMNS],
}

/// A tensor that is zero.
#[derive(Clone, Debug)]
pub struct Equality {
    /// Names it in an error.
    pub name: &'static str,
    /// Its axes, from the lowest.
    pub axes: Vec<Axis>,
    /// Its values.
    pub linear: LinearSum,
}

/// The same statement about several instances. Each has sources of its own for what is committed to, so that a prover needs one of them in
/// memory at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instances {
    /// The axis whose indices are the instances. Whatever is looked up or zero has it.
    pub axis: Axis,
    /// How many there are. Indices from there on have no instance, and count nowhere.
    pub count: usize,
}

/// The whole statement.
#[derive(Default)]
pub struct Relations {
    /// Bits of each axis.
    pub axes: Vec<u8>,
    /// Whether the statement is about several instances.
    pub instances: Option<Instances>,
    /// Sources whose values everybody can have. Claims about them are published.
    pub published: Vec<ColumnSource>,
    /// What was committed to.
    pub tensors: Vec<Tensor>,
    /// Maps from indices to indices.
    pub maps: Vec<Vec<Option<u16>>>,
    /// Vectors along an axis.
    pub coefficients: Vec<(Axis, Vec<Goldilocks>)>,
    /// Tensors that are views of others.
    pub virtuals: Vec<Virtual>,
    /// Tensors of sums of products.
    pub products: Vec<Product>,
    /// Tensors of products.
    pub monomials: Vec<Monomials>,
    /// Sums over axes.
    pub sums: Vec<Summed>,
    /// Tensors that both sides compute.
    pub publics: Vec<Box<dyn Public>>,
    /// What is looked up, and the tables.
    pub lookups: Vec<Lookup>,
    /// What is zero.
    pub equalities: Vec<Equality>,
}

impl Relations {
    /// Bits of an axis.
    pub fn bits(&self, axis: Axis) -> usize {
        self.axes[axis.0 as usize] as usize
    }

    /// Bits of all of `axes` together, but that of instances.
    pub fn size_of_one(&self, axes: &[Axis]) -> usize {
        let own = axes.iter().filter(|axis| !self.are_instances(**axis));
        own.map(|&axis| self.bits(axis)).sum()
    }

    /// Whether this is the axis of instances.
    pub fn are_instances(&self, axis: Axis) -> bool {
        self.instances
            .is_some_and(|instances| instances.axis == axis)
    }

    /// How many instances there are.
    pub fn count_of_instances(&self) -> usize {
        self.instances.map_or(1, |instances| instances.count)
    }

    /// Bits of the axis of instances.
    pub fn bits_of_instances(&self) -> usize {
        self.instances
            .map_or(0, |instances| self.bits(instances.axis))
    }

    /// Bits of all of `axes` together.
    pub fn size(&self, axes: &[Axis]) -> usize {
        axes.iter().map(|&axis| self.bits(axis)).sum()
    }
}
