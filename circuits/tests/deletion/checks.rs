//! The checks. Each is a text of the source, and when it is out, a cheat passes. Every text must be in the source exactly once. When the source
//! changes, the text here must change with it.

use zk0_testkit::changed_copy::switched;

/// Code that gets a switch which takes a check out at run time, and what stands in its place then: another value, or nothing in place of a statement.
/// Where the second text has `OUT`, it takes the place of the code, and asks the switch itself.
type Replacement = (&'static str, &'static str);

/// A check, and the cheat that it stops.
pub struct Deletion {
    pub check: &'static str,
    pub file: &'static str,
    pub replacements: &'static [Replacement],
    pub cheat: &'static str,
    /// How the whole code refuses the cheat.
    pub refused: &'static str,
    /// How the code without the check refuses it, where another check stops the same cheat.
    pub still_refused: Option<&'static str>,
}

const fn check(
    check: &'static str,
    file: &'static str,
    replacements: &'static [Replacement],
    cheat: &'static str,
    refused: &'static str,
) -> Deletion {
    Deletion {
        check,
        file,
        replacements,
        cheat,
        refused,
        still_refused: None,
    }
}

impl Deletion {
    /// States that another check stops the cheat as well, with this reason.
    const fn still(mut self, refused: &'static str) -> Self {
        self.still_refused = Some(refused);
        self
    }

    /// Describes what is deleted.
    pub fn text(&self) -> String {
        let each = |(code, left): &Replacement| match *left {
            "" => format!("{}: `{code}`", self.file),
            left => format!("{}: `{code}`, now `{left}`", self.file),
        };
        let all: Vec<String> = self.replacements.iter().map(each).collect();
        all.join("; ")
    }

    /// Returns the source with the switch of this check, or an error that names the text that is not there exactly once.
    pub fn switched(&self, source: &str) -> Result<String, String> {
        let mut source = source.to_string();
        for (code, left) in self.replacements {
            let found = source.matches(code).count();
            if found != 1 {
                return Err(format!(
                    "to delete '{}', `{code}` has to be in src/{} once and is there {found} times; \
                     if the source has changed, change this test's replacement too",
                    self.check, self.file
                ));
            }
            let asked = match *left {
                "" => format!("if !OUT {{ {code} }}"),
                left if left.contains("OUT") => left.into(),
                left => format!("(if OUT {{ {left} }} else {{ {code} }})"),
            };
            source = source.replace(code, &switched(&asked, self.check));
        }
        Ok(source)
    }
}

/// The path of an opening is verified.
const PATH: &str = "merkle::verify(&dataset.root, dataset.samples, drawn, leaf, path)";

/// It is that of the sample which the node names, and not of the drawn one.
const PATH_OF_ANOTHER: Replacement = (
    PATH,
    "merkle::verify(&dataset.root, dataset.samples, *index, leaf, path)",
);

/// All checks.
pub const DELETIONS: &[Deletion] = &[
    // These checks are about the samples that are opened.
    check(
        "number of openings",
        "claim/statement.rs",
        &[("claimed as usize != opened", "false")],
        "opens the helpful samples only",
        "claim evaluates 4 samples, but the private input opens 2",
    ),
    check(
        "salt",
        "claim/statement.rs",
        &[(
            "salt_commitment(&header.salt) != dataset.salt_commitment",
            "false",
        )],
        "salts copies of a sample",
        "salt is not the one committed",
    ),
    check(
        "distinct samples",
        "claim/challenge.rs",
        &[("!indices.contains(&index)", "true")],
        "opens one sample twice",
        "opening 1 is of sample 0",
    ),
    check(
        "drawn index, in the opening and in the path",
        "claim/statement.rs",
        &[("*index != drawn", "false"), PATH_OF_ANOTHER],
        "opens a lucky sample instead",
        "the challenge draws sample",
    ),
    check(
        "drawn index, in the opening alone",
        "claim/statement.rs",
        &[("*index != drawn", "false")],
        "opens a lucky sample instead",
        "the challenge draws sample",
    )
    .still("its path does not lead to the dataset root"),
    check(
        "drawn index, in the path alone",
        "claim/statement.rs",
        &[PATH_OF_ANOTHER],
        "opens a lucky sample instead",
        "the challenge draws sample",
    )
    .still("the challenge draws sample"),
    check(
        "Merkle path",
        "claim/statement.rs",
        &[(PATH, "true")],
        "invents a sample",
        "its path does not lead to the dataset root",
    ),
    check(
        "Merkle path: root",
        "vm/merkle.rs",
        &[("last == 0 && hash == *root", "last == 0")],
        "invents a sample",
        "its path does not lead to the dataset root",
    ),
    check(
        "Merkle path: not too short",
        "vm/merkle.rs",
        &[("last == 0 && hash == *root", "hash == *root")],
        "counts more samples than there are",
        "its path does not lead to the dataset root",
    ),
    check(
        "Merkle path: not too long",
        "vm/merkle.rs",
        &[("if last == 0 {", "if !OUT && last == 0 {")],
        "hides more samples than it counts",
        "its path does not lead to the dataset root",
    ),
    check(
        "sample: pad mask of 0 and 1",
        "model/sample.rs",
        &[("value >> 1 != 0", "false")],
        "flags copies of a sample",
        "pad mask of frame 5",
    ),
    check(
        "sample: padding at the end",
        "model/sample.rs",
        &[("(pad && frame == 0) || (padding && !pad)", "false")],
        "masks frames of copies",
        "pad mask is out of order at frame",
    ),
    check(
        "sample: zeros in padding",
        "model/sample.rs",
        &[(
            "if pad { 0 } else { dims.action_dim as usize }",
            "dims.action_dim as usize",
        )],
        "writes into the padding of copies",
        "it must be 0, because it is not read",
    ),
    check(
        "sample: zeros in unused dimensions",
        "model/sample.rs",
        &[(
            "if pad { 0 } else { dims.action_dim as usize }",
            "if pad { 0 } else { width }",
        )],
        "writes into unused dimensions of copies",
        "it must be 0, because it is not read",
    ),
    check(
        "sample: zeros behind the last value",
        "vm/values.rs",
        &[("|&value| value == 0", "|&value| OUT || value == 0")],
        "pads copies of a sample",
        "with zeros as padding",
    ),
    // These checks are about the weights.
    check(
        "digest of the update",
        "claim/statement.rs",
        &[(
            "(Model::Update, terms.update)] {",
            "(Model::Update, terms.update)] { if OUT && model == Model::Update { continue; }",
        )],
        "evaluates another update",
        "the digest of the update weights is not the one in the terms",
    ),
    check(
        "digest of the base",
        "claim/statement.rs",
        &[(
            "(Model::Update, terms.update)] {",
            "(Model::Update, terms.update)] { if OUT && model == Model::Base { continue; }",
        )],
        "evaluates another base",
        "the digest of the base weights is not the one in the terms",
    ),
    // These checks are about the range of values.
    check(
        "values between products fit",
        "model/arithmetic/fixed.rs",
        &[("self.seen >> 16 == 0", "true")],
        "wraps a norm",
        "final norm: ",
    ),
    check(
        "sums of a linear layer fit",
        "model/multiply.rs",
        &[
            ("fit.check(output.site, self.overflow)?;", ""),
            (
                "sum.clamp(i32::MIN.into(), i32::MAX.into()) as i32",
                "sum as i32",
            ),
        ],
        "wraps a velocity",
        "velocity (action_out_proj): ",
    ),
    check(
        "attention outputs fit",
        "model/multiply.rs",
        &[
            ("fit.check(site, self.overflow)?;", ""),
            (
                "sum.clamp(i32::MIN.into(), i32::MAX.into()) as i32",
                "sum as i32",
            ),
        ],
        "wraps attention outputs",
        "attention output: 32771 does not fit",
    ),
    // These checks are about losses.
    check(
        "improvement",
        "claim/statement.rs",
        &[("!test.passes(pairs)", "false")],
        "contributes what is worse",
        "which does not show an improvement by 100 basis points",
    ),
    check(
        "improvement: a lower loss",
        "claim/t_test.rs",
        &[("sum <= 0", "false")],
        "contributes what is worse",
        "which does not show an improvement by 100 basis points",
    ),
    check(
        "improvement: strictly lower",
        "claim/t_test.rs",
        &[("sum <= 0", "sum < 0"), ("left > right", "left >= right")],
        "contributes the base itself",
        "which does not show an improvement by 0 basis points",
    ),
    check(
        "improvement: by its minimum",
        "claim/t_test.rs",
        &[("ONE - (self.min_improvement_bps as i128).min(ONE)", "ONE")],
        "improves less than it states",
        "which does not show an improvement by 9000 basis points",
    ),
    check(
        "improvement: not by chance",
        "claim/t_test.rs",
        &[("left > right", "left > U256::ZERO")],
        "improves by chance",
        "at a confidence of 95%",
    ),
    // These checks are about the specification.
    check(
        "specification: scales of the cache",
        "model/spec.rs",
        &[(
            "(layer.key != layer.cache_key || layer.value != layer.cache_value)",
            "false",
        )],
        "misreads the cache",
        "must have the scale of the cache",
    ),
    check(
        "specification: the one that the terms name",
        "claim/statement.rs",
        &[("claimed == given", "true")],
        "evaluates by another specification",
        "the terms name the evaluation specification with digest",
    ),
    check(
        "specification: limits of a scale",
        "model/spec.rs",
        &[("scale(\"action\", self.action, 1, 12)?;", "")],
        "wraps the noise",
        "scale action has 14 fraction bits",
    ),
];
