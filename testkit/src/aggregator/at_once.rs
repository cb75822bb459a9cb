//! An aggregator without a service: requests take all steps at once.

use std::sync::Arc;
use std::time::Duration;
use zk0_aggregator::publish::beacon::BeaconServers;
use zk0_aggregator::round::intake::admission::Admission;
use zk0_aggregator::round::intake::group::ToRecord;
use zk0_aggregator::round::intake::statements::{decode, read_signed, SentStatement};
use zk0_aggregator::round::intake::submission::SubmissionAnswer;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::{Aggregator, JobResult, Polled, RoundJob};
use zk0_ledger::blobs::partial::PartialBlob;
use zk0_protocol::entries::authentic::Authentic;
use zk0_protocol::entries::signed::{Signed, Submission, UploadRequest};
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::federation::RecordRequest;
use zk0_protocol::Receipt;

/// Requests as bytes.
pub trait AtOnce {
    /// Records a message.
    fn tell(&mut self, body: &[u8]) -> Result<Receipt, RequestError>;
    /// Records an enrolment.
    fn let_in(&mut self, enrolment: &[u8]) -> Result<Receipt, RequestError>;
    /// Records a dataset with drawn frames.
    fn register(&mut self, registration: &[u8], leaves: &[u8]) -> Result<Receipt, RequestError>;
    /// Begins an upload, unless the blob is there.
    fn upload(&self, request: &[u8]) -> Result<Option<PartialBlob>, RequestError>;
    /// Records a commitment.
    fn commit(&mut self, commitment: &[u8]) -> Result<Receipt, RequestError>;
    /// Decides a submission.
    fn submit(
        &mut self,
        submission: &[u8],
        proof: Vec<u8>,
    ) -> Result<SubmissionAnswer, RequestError>;
    /// Polls the rounds.
    fn step(&mut self) -> Result<Polled, RequestError>;
    /// Polls, and runs jobs.
    fn go_on(&mut self) -> Result<Polled, RequestError>;
}

impl AtOnce for Aggregator {
    fn tell(&mut self, body: &[u8]) -> Result<Receipt, RequestError> {
        stated(self, Statement::Body(body.into()), &[])
    }

    fn let_in(&mut self, enrolment: &[u8]) -> Result<Receipt, RequestError> {
        stated(self, Statement::Enrolment(enrolment.into()), &[])
    }

    fn register(&mut self, registration: &[u8], leaves: &[u8]) -> Result<Receipt, RequestError> {
        let body = [&[DATASET_COMMITTED][..], registration].concat();
        stated(self, Statement::Body(body), leaves)
    }

    fn upload(&self, request: &[u8]) -> Result<Option<PartialBlob>, RequestError> {
        let signed: Authentic<UploadRequest> = read_signed("upload request", request)?;
        match self.begin_upload(&signed.statement)? {
            None => Ok(None),
            Some(staging) => Ok(staging.go_on(&signed.statement, 0)?),
        }
    }

    fn commit(&mut self, commitment: &[u8]) -> Result<Receipt, RequestError> {
        let body = [&[UPDATE_COMMITTED][..], commitment].concat();
        stated(self, Statement::Body(body), &[])
    }

    fn submit(
        &mut self,
        submission: &[u8],
        proof: Vec<u8>,
    ) -> Result<SubmissionAnswer, RequestError> {
        let signed: Signed<Submission> = decode("submission", submission)?;
        let compared = self.begin_submission(&signed, self.now_ms());
        let answer = |receipt, body| SubmissionAnswer::of(&signed, receipt, body);
        let pending = match compared.admission(self.ledger().reader(), answer)? {
            Admission::Recorded(decided) => return Ok(decided),
            Admission::New(pending) => pending,
        };
        let (pending, contribution) = pending.authenticate(signed, proof)?;
        let judged = pending.judge(contribution)?.keep()?;
        let rejected = judged.rejected().cloned();
        let receipt = one(self, ToRecord::Decision(Box::new(judged)))?;
        Ok(SubmissionAnswer { rejected, receipt })
    }

    fn step(&mut self) -> Result<Polled, RequestError> {
        let now_ms = self.arrivals().now_ms()?;
        self.poll(now_ms)
    }

    fn go_on(&mut self) -> Result<Polled, RequestError> {
        let mut polled = self.step()?;
        while let Polled::Run(job) = polled {
            polled = match run_job(job)? {
                Ok(result) => self.finish(result)?,
                Err(polled) => polled,
            };
        }
        Ok(polled)
    }
}

/// Runs a job without beacons.
pub fn run_job(job: RoundJob) -> Result<Result<JobResult, Polled>, RequestError> {
    job.run(&BeaconServers::new(Vec::new(), Duration::ZERO))
}

/// First bytes of dataset and commitment entries, before the signed statements.
const DATASET_COMMITTED: u8 = 2;
const UPDATE_COMMITTED: u8 = 4;

fn stated(
    aggregator: &mut Aggregator,
    statement: Statement,
    leaves: &[u8],
) -> Result<Receipt, RequestError> {
    let sent = Arc::new(SentStatement::read(RecordRequest {
        statement: Some(statement),
        leaves: leaves.into(),
    })?);
    let compared = aggregator.begin_statement(sent.clone(), aggregator.now_ms());
    let ledger = aggregator.ledger().reader().clone();
    match compared.admission(&ledger, |receipt, body| sent.answer(receipt, body))? {
        Admission::Recorded(receipt) => Ok(receipt),
        Admission::New(allowed) => {
            let body = allowed.keep(&ledger)?;
            one(aggregator, ToRecord::Statement(Box::new(body)))
        }
    }
}

fn one(aggregator: &mut Aggregator, what: ToRecord) -> Result<Receipt, RequestError> {
    let now = aggregator.now_ms();
    let recorded = aggregator.record(vec![(now, what)]).pop().unwrap()?;
    Ok(aggregator.ledger().first_receipt(recorded)?)
}
