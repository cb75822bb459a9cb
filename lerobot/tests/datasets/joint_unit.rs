//! The unit of a recording's joints, told from values that LeRobot made of motor positions.

use std::collections::BTreeMap;
use std::sync::Arc;

use arrow_array::builder::{FixedSizeListBuilder, Float32Builder};
use arrow_array::RecordBatch;
use zk0_lerobot::dataset::JointUnit;
use zk0_testkit::recordings::{fixtures, Copy};

#[test]
fn the_unit_is_told_from_what_lerobot_records() {
    let positions = std::fs::read(fixtures().join("joint_units/positions.json")).unwrap();
    let positions: BTreeMap<String, Vec<[f32; 6]>> = serde_json::from_slice(&positions).unwrap();
    for (name, unit, why) in [
        ("degrees", JointUnit::Degrees, "reaches "),
        ("degrees_within_100", JointUnit::Degrees, "whole steps"),
        (
            "range",
            JointUnit::MinusToPlus100,
            "main_shoulder_pan stops at -100,",
        ),
        (
            "range_inside",
            JointUnit::Unclear,
            "no joint goes beyond 100",
        ),
    ] {
        let copy = Copy::default();
        copy.edit_rows(|rows| with_states(&rows, &positions[name]));
        let (found, because) = copy.open().unwrap().joint_unit();
        assert_eq!(found, unit, "{name}: {because}");
        assert!(because.contains(why), "{name}: {because}");
    }
}

/// The same rows with these states, again and again.
fn with_states(rows: &RecordBatch, states: &[[f32; 6]]) -> RecordBatch {
    let at = rows.schema().index_of("observation.state").unwrap();
    let mut list = FixedSizeListBuilder::new(Float32Builder::new(), 6);
    for state in states.iter().cycle().take(rows.num_rows()) {
        list.values().append_slice(state);
        list.append(true);
    }
    let field = Arc::new(arrow_schema::Field::new(
        "observation.state",
        arrow_schema::DataType::new_fixed_size_list(arrow_schema::DataType::Float32, 6, true),
        true,
    ));
    let mut fields = rows.schema().fields().to_vec();
    fields[at] = field;
    let mut columns = rows.columns().to_vec();
    columns[at] = Arc::new(list.finish());
    RecordBatch::try_new(Arc::new(arrow_schema::Schema::new(fields)), columns).unwrap()
}
