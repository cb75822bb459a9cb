// Verifies what zk0 publishes with an implementation that is not zk0's: golang.org/x/mod/sumdb, which the Go project checks its
// module database with. Run by ledger/tests/other_implementations/go.rs.
package main

import (
	"bytes"
	"crypto/ed25519"
	"encoding/base64"
	"encoding/binary"
	"encoding/hex"
	"errors"
	"fmt"
	"os"
	"strconv"
	"strings"

	"golang.org/x/mod/sumdb/note"
	"golang.org/x/mod/sumdb/tlog"
)

// A witness' key, for cosignature/v1, which sumdb/note does not know.
type witness struct {
	name string
	id   uint32
	key  ed25519.PublicKey
}

func (w witness) Name() string    { return w.name }
func (w witness) KeyHash() uint32 { return w.id }
func (w witness) Verify(text, signature []byte) bool {
	if len(signature) != 72 {
		return false
	}
	message := fmt.Sprintf("cosignature/v1\ntime %d\n%s", binary.BigEndian.Uint64(signature), text)
	return ed25519.Verify(w.key, []byte(message), signature[8:])
}

func newWitness(vkey string) (witness, error) {
	parts := strings.SplitN(vkey, "+", 3)
	if len(parts) != 3 {
		return witness{}, errors.New("not a verifier key")
	}
	id, err := strconv.ParseUint(parts[1], 16, 32)
	if err != nil {
		return witness{}, err
	}
	key, err := base64.StdEncoding.DecodeString(parts[2])
	if err != nil || len(key) != 33 || key[0] != 4 {
		return witness{}, errors.New("not a cosigner's key")
	}
	return witness{parts[0], uint32(id), key[1:]}, nil
}

func parse(text string) (size int64, root tlog.Hash, err error) {
	lines := strings.Split(text, "\n")
	if len(lines) != 4 || lines[3] != "" {
		return 0, root, errors.New("not three lines")
	}
	if size, err = strconv.ParseInt(lines[1], 10, 64); err != nil {
		return
	}
	root, err = tlog.ParseHash(lines[2])
	return
}

// A tlog-proof bundle: its extra data, index, path and checkpoint.
func split(bundle []byte) (extra []byte, index int64, path tlog.RecordProof, checkpoint []byte, err error) {
	head, checkpoint, _ := bytes.Cut(bundle, []byte("\n\n"))
	lines := strings.Split(string(head), "\n")
	if len(lines) < 3 || lines[0] != "c2sp.org/tlog-proof@v1" {
		err = errors.New("not a tlog-proof with an entry in it")
		return
	}
	if extra, err = base64.StdEncoding.DecodeString(strings.TrimPrefix(lines[1], "extra ")); err != nil {
		return
	}
	if index, err = strconv.ParseInt(strings.TrimPrefix(lines[2], "index "), 10, 64); err != nil {
		return
	}
	for _, line := range lines[3:] {
		var hash tlog.Hash
		if hash, err = tlog.ParseHash(line); err != nil {
			return
		}
		path = append(path, hash)
	}
	return
}

func run() error {
	log, err := note.NewVerifier(os.Args[1])
	if err != nil {
		return err
	}
	witness, err := newWitness(os.Args[2])
	if err != nil {
		return err
	}
	bundle, err := os.ReadFile(os.Args[3])
	if err != nil {
		return err
	}
	extra, index, path, checkpoint, err := split(bundle)
	if err != nil {
		return err
	}
	opened, err := note.Open(checkpoint, note.VerifierList(log, witness))
	if err != nil {
		return err
	}
	size, root, err := parse(opened.Text)
	if err != nil {
		return err
	}
	if err := tlog.CheckRecord(path, size, root, index, tlog.RecordHash(extra)); err != nil {
		return err
	}
	fmt.Printf("%d signatures, entry %d of %d, root %s\n", len(opened.Sigs), index, size, hex.EncodeToString(root[:]))
	return nil
}

func main() {
	if err := run(); err != nil {
		fmt.Println("refused:", err)
		os.Exit(1)
	}
}
