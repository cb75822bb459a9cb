//! What a verifier knows of secret values, and the equations between them.
//!
//! The prover states a secret value s as c = s + u, where u is the next element of a committed vector of random ones: its *pad* (Cramer and
//! Damgård 1998; for sumchecks over a commitment to a vector, Frigo and shelat, eprint 2024/2010). A verifier calculates with [`Form`]s of secret
//! values. A product of two of them is a *gate*. What an argument has to fulfil is a list of equations, [`Equations`], which [`crate::opening`]
//! shows at the end.

use crate::field::Extension;
use crate::transcript::{require, Refused};
use alloc::vec;
use alloc::vec::Vec;

/// What a form is made of beside what is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// The secret value with this number, which is that of its pad.
    Said(u32),
    /// The product with this number.
    Gate(u32),
}

/// `known + Σ coefficient · unknown`. An unknown may be there more than once.
#[derive(Clone, Debug, Default)]
pub struct Form {
    known: Extension,
    terms: Vec<(Unknown, Extension)>,
}

impl Form {
    /// The secret value with this number.
    pub fn of_said(number: usize) -> Self {
        Self {
            known: Extension::ZERO,
            terms: vec![(Unknown::Said(number as u32), Extension::ONE)],
        }
    }

    /// Makes room for so many more unknowns. A form that grows does so often, and a guest pays for each copy.
    #[inline(always)]
    pub fn reserve(&mut self, count: usize) {
        if self.terms.capacity() - self.terms.len() < count {
            self.terms.reserve(count.max(3 * self.terms.len()));
        }
    }

    /// Adds `factor` times the secret value with this number.
    #[inline(always)]
    pub fn add_said(&mut self, factor: Extension, number: usize) {
        self.terms.push((Unknown::Said(number as u32), factor));
    }

    /// Multiplies by a known value.
    pub fn scale(&mut self, factor: Extension) {
        self.known *= factor;
        for (_, coefficient) in &mut self.terms {
            *coefficient *= factor;
        }
    }

    /// Adds the coefficients of secret values and of gates, times `factor`, to sums, of which there is one for each.
    fn add_to(&self, factor: Extension, sums: &mut Combined) {
        if self.known != Extension::ZERO {
            sums.known += factor * self.known;
        }
        for &(unknown, coefficient) in &self.terms {
            // Many unknowns stand alone.
            let product = if coefficient == Extension::ONE {
                factor
            } else {
                factor * coefficient
            };
            match unknown {
                Unknown::Said(number) => sums.said[number as usize] += product,
                Unknown::Gate(number) => sums.gates[number as usize] += product,
            }
        }
    }

    /// The value, for secret values and gates that are known.
    pub fn value(&self, said: &[Extension], gates: &[Extension]) -> Extension {
        let terms = self.terms.iter().map(|&(unknown, coefficient)| {
            coefficient
                * match unknown {
                    Unknown::Said(number) => said[number as usize],
                    Unknown::Gate(number) => gates[number as usize],
                }
        });
        self.known + terms.sum()
    }
}

impl From<Extension> for Form {
    fn from(known: Extension) -> Self {
        Self {
            known,
            terms: vec![],
        }
    }
}

/// A value that the prover does not show: the value itself for the prover, and a [`Form`] for the verifier. A known one is both.
pub trait Secret: Clone + Default + From<Extension> {
    /// Adds `factor · other`.
    fn add(&mut self, factor: Extension, other: &Self);

    /// Adds a known value.
    fn add_known(&mut self, value: Extension);

    /// `factor · self`.
    fn times(&self, factor: Extension) -> Self {
        let mut product = Self::default();
        product.add(factor, self);
        product
    }

    /// `self − other`.
    fn minus(mut self, other: &Self) -> Self {
        self.add(-Extension::ONE, other);
        self
    }
}

impl Secret for Extension {
    fn add_known(&mut self, value: Extension) {
        *self += value;
    }

    fn add(&mut self, factor: Extension, other: &Self) {
        *self += factor * *other;
    }
}

impl Secret for Form {
    fn add_known(&mut self, value: Extension) {
        self.known += value;
    }

    fn add(&mut self, factor: Extension, other: &Self) {
        if other.known != Extension::ZERO {
            self.known += factor * other.known;
        }
        self.reserve(other.terms.len());
        if factor == Extension::ONE {
            self.terms.extend_from_slice(&other.terms);
            return;
        }
        let terms = other.terms.iter();
        self.terms
            .extend(terms.map(|&(unknown, coefficient)| (unknown, factor * coefficient)));
    }
}

/// Equations between secret values.
#[derive(Default)]
pub struct Equations {
    /// Forms that are zero, by the name of what they state.
    zeros: Vec<(&'static str, Form)>,
    /// The factors of each product.
    gates: Vec<[Form; 2]>,
}

/// The sum of all equations, with random weights: `known + Σ stated·s + Σ gates·a·b` is zero.
pub struct Combined {
    /// What is known.
    pub known: Extension,
    /// The coefficient of each secret value.
    pub said: Vec<Extension>,
    /// The coefficient of each product.
    pub gates: Vec<Extension>,
}

impl Equations {
    /// How many products there are.
    pub fn count_of_gates(&self) -> usize {
        self.gates.len()
    }

    /// `a · b`, for forms that are no products of two secret values themselves.
    pub fn product(&mut self, a: &Form, b: &Form) -> Result<Form, Refused> {
        for (known, other) in [(a, b), (b, a)] {
            if known.terms.is_empty() {
                return Ok(other.times(known.known));
            }
        }
        let of_gates = |(unknown, _): &(Unknown, _)| matches!(unknown, Unknown::Gate(_));
        let higher = a.terms.iter().chain(&b.terms).any(of_gates);
        require(!higher, Refused::Bounds("the degree of a relation"))?;
        self.gates.push([a.clone(), b.clone()]);
        let gate = Unknown::Gate(self.gates.len() as u32 - 1);
        Ok(Form {
            known: Extension::ZERO,
            terms: vec![(gate, Extension::ONE)],
        })
    }

    /// States that a form is zero. What is known to be another value is refused at once.
    pub fn zero(&mut self, what: &'static str, form: Form) -> Result<(), Refused> {
        if form.terms.is_empty() {
            return require(form.known == Extension::ZERO, Refused::Equation(what));
        }
        self.zeros.push((what, form));
        Ok(())
    }

    /// The sum of all equations times powers of `tau`, for so many secret values.
    pub fn combined(&self, tau: Extension, said: usize) -> Combined {
        let mut combined = Combined {
            known: Extension::ZERO,
            said: vec![Extension::ZERO; said],
            gates: vec![Extension::ZERO; self.gates.len()],
        };
        let mut power = Extension::ONE;
        for (_, form) in &self.zeros {
            form.add_to(power, &mut combined);
            power *= tau;
        }
        combined
    }

    /// Adds the factors of all products, each times the next weight.
    pub fn add_factors(&self, mut weight: impl FnMut() -> Extension, sums: &mut Combined) {
        for form in self.gates.iter().flatten() {
            form.add_to(weight(), sums);
        }
    }

    /// The factors of each product, for secret values that are known.
    pub fn factors(&self, said: &[Extension]) -> Vec<[Extension; 2]> {
        let gates = self.gates.iter();
        gates
            .map(|[a, b]| [a, b].map(|form| form.value(said, &[])))
            .collect()
    }

    /// The name of the first equation that does not hold, for secret values that are known.
    pub fn unmet(&self, said: &[Extension]) -> Option<&'static str> {
        let gates = self.factors(said).into_iter();
        let gates: Vec<Extension> = gates.map(|[a, b]| a * b).collect();
        let mut zeros = self.zeros.iter();
        let unmet = zeros.find(|(_, form)| form.value(said, &gates) != Extension::ZERO);
        unmet.map(|(what, _)| *what)
    }
}
