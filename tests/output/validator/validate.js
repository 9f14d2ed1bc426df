// Prints every error that the validator finds in a folder's .glb files; exit code 1 when there are any.
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import validator from 'gltf-validator';

const folder = process.argv[2];
const files = readdirSync(folder).filter((name) => name.endsWith('.glb')).sort();
let errors = 0;
for (const name of files) {
  const bytes = new Uint8Array(readFileSync(join(folder, name)));
  const report = await validator.validateBytes(bytes, { uri: name, maxIssues: 0 });
  for (const { severity, code, pointer, message } of report.issues.messages) {
    // An image that a .glb may not hold by the source's own extensions stays a reference.
    if (severity !== 0 || code === 'IO_ERROR') continue;
    errors++;
    console.log(`${name} ${pointer}: ${code}: ${message}`);
  }
}
console.log(`glTF validator ${validator.version()}: ${files.length} files, ${errors} errors`);
process.exit(errors > 0 || files.length === 0 ? 1 : 0);
