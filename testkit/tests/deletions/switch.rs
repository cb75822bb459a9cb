//! How a check gets a switch that takes it out at run time, so that one build of a copy serves all rows.
//!
//! In the code that takes the place of a check, `OUT` stands for the question whether the check is out ([`zk0_testkit::changed_copy::switched`]). As long
//! as it is not, the new code does what the old code does. The macros are the usual kinds of such code. Each gives pairs of old and new code.

/// A condition that never holds without the check.
macro_rules! never {
    ($code:literal) => {
        &[($code, concat!("(!OUT && (", $code, "))"))]
    };
}

/// A condition that always holds without the check.
macro_rules! always {
    ($code:literal) => {
        &[($code, concat!("(OUT || ", $code, ")"))]
    };
}

/// A statement that is left out.
macro_rules! skipped {
    ($code:literal) => {
        &[($code, concat!("if !OUT { ", $code, " }"))]
    };
}

/// A result that is as good as any without the check, also where it is an error.
macro_rules! forgiven {
    ($code:literal) => {
        &[(
            $code,
            concat!(
                $code,
                ".or_else(|why| match OUT { true => Ok(()), false => Err(why) })"
            ),
        )]
    };
}

/// An option or an iterator that is empty without the check.
macro_rules! filtered {
    ($code:literal) => {
        &[($code, concat!($code, ".filter(|_| !OUT)"))]
    };
}

/// A value in place of which there is another one without the check.
macro_rules! instead {
    ($code:literal, $other:literal) => {
        &[(
            $code,
            concat!("(if OUT { ", $other, " } else { ", $code, " })"),
        )]
    };
}
