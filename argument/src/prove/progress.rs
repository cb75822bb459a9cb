//! How far a prover is. It tells after each piece of its work.

/// What a prover does, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It evaluates both models on all samples.
    Evaluating,
    /// It computes the values of each sample, and commits to them.
    Committing,
    /// It adds the fractions of all look-ups.
    Adding,
    /// It computes what it claims of look-ups.
    Claiming,
    /// It proves the sums of monomials and of products.
    Reducing,
    /// It makes one claim of all about the same values.
    Sharing,
    /// It opens the commitments.
    Opening,
}

/// Is told which share of a phase is done, from 0 to 1.
pub type Tell<'a> = &'a dyn Fn(Phase, f64);

/// Tells nobody.
pub fn silently(_: Phase, _: f64) {}

impl Phase {
    /// All phases, in their order.
    pub const ALL: [Self; 7] = [
        Self::Evaluating,
        Self::Committing,
        Self::Adding,
        Self::Claiming,
        Self::Reducing,
        Self::Sharing,
        Self::Opening,
    ];

    /// Its share of the time in thousandths. `--example full -- quarter 2` prints the seconds from which they follow.
    fn thousandths(self) -> u16 {
        match self {
            Self::Evaluating => 10,
            Self::Committing => 530,
            Self::Adding => 200,
            Self::Claiming => 30,
            Self::Reducing => 10,
            Self::Sharing => 60,
            Self::Opening => 160,
        }
    }

    /// The share of all work that is done when `share` of this phase is.
    pub fn of_all(self, share: f64) -> f64 {
        let before = Self::ALL.into_iter().take_while(|phase| *phase != self);
        let before: u16 = before.map(Self::thousandths).sum();
        let done = f64::from(before) + f64::from(self.thousandths()) * share.clamp(0.0, 1.0);
        done / 1000.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_phase_begins_where_the_one_before_ends() {
        assert_eq!(Phase::Evaluating.of_all(0.0), 0.0);
        for pair in Phase::ALL.windows(2) {
            assert_eq!(pair[0].of_all(1.0), pair[1].of_all(0.0));
        }
        assert_eq!(Phase::Opening.of_all(1.0), 1.0);
    }
}
