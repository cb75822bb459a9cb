//! Downloads that were cut.

use crate::Test;
use tonic::{Code, Status};
use zk0_circuits::Digest;
use zk0_protocol::rpc::federation as proto;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

#[tokio::test(flavor = "multi_thread")]
async fn a_download_begins_where_it_is_told_to() -> Test {
    let (network, ..) = open_round().await;
    let base = weights(0);
    let from = async |begins: usize| -> Result<Vec<u8>, Status> {
        let request = proto::DownloadRequest {
            blob: blob_digest(&base).0.to_vec(),
            begins: begins as u64,
        };
        let mut parts = network.client().await.download(request).await?.into_inner();
        let mut bytes = vec![];
        while let Some(part) = parts.message().await? {
            bytes.extend(part.data);
        }
        Ok(bytes)
    };
    for begins in [0, 1, 5000, base.len()] {
        assert_eq!(from(begins).await?, base[begins..]);
    }
    refused(
        from(base.len() + 1).await,
        Code::InvalidArgument,
        "and no byte",
    );
    assert_eq!(
        network.download(Digest([9; 32])).await.unwrap_err().code(),
        Code::NotFound
    );
    Ok(())
}
