// Usage: node compare.js DOCS BROWSER FOLDER ...     DOCS is docs/lit-scenes.md.
// Fails where the pages embedded in a folder's lit.glb differ from its EXR by more than 1 % root mean
// square of the mean, as three.js shows both.
import fs from 'node:fs';
import http from 'node:http';
import path from 'node:path';
import puppeteer from 'puppeteer-core';

const [docs, browserPath, ...folders] = process.argv.slice(2);
// The code under test is that of the documentation.
const [, loader] = fs.readFileSync(docs, 'utf8').match(/```js\n(\/\/ lightkiln-lightmaps\.js\n[^]*?)```/);
const types = { '.html': 'text/html', '.js': 'text/javascript' };

function fileOf(url) {
  const [, folder, name] = url.match(/^\/result\/(\d+)\/([\w.]+)$/) ?? [];
  if (folder) return path.join(folders[folder], name);
  return url.startsWith('/three/') ? path.join('node_modules', url) : path.basename(url);
}

const server = http.createServer((request, response) => {
  if (request.url === '/favicon.ico') return response.writeHead(204).end();
  response.setHeader('Content-Type', types[path.extname(request.url)] ?? 'application/octet-stream');
  if (request.url === '/loader.js') return response.end(loader);
  const file = fileOf(request.url);
  if (!fs.existsSync(file)) return response.writeHead(404).end();
  response.end(fs.readFileSync(file));
});
await new Promise((done) => server.listen(0, '127.0.0.1', done));
const browser = await puppeteer.launch({
  executablePath: browserPath,
  args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
  protocolTimeout: 300_000,
});
let failed = false;
try {
  const page = await browser.newPage();
  page.on('console', (message) => console.log('browser:', message.text()));
  page.on('pageerror', (error) => {
    console.log('browser:', String(error));
    failed = true;
  });
  await page.goto(`http://127.0.0.1:${server.address().port}/page.html`);
  await page.waitForFunction('window.ready');
  for (const [i, folder] of folders.entries()) {
    const manifest = JSON.parse(fs.readFileSync(path.join(folder, 'manifest.json')));
    const found = await page.evaluate((url, size) => window.compare(url, size), `/result/${i}/`,
      manifest.pages[0].width);
    console.log(`${folder}: ${(100 * found.rms).toFixed(3)} % of the mean, ${found.mean.toPrecision(4)} lx,`
      + ` over ${found.texels} texels`);
    failed ||= !(found.rms <= 0.01 && found.texels > 1000);
  }
} finally {
  await browser.close();
  server.close();
}
process.exit(failed ? 1 : 0);
