// The command line that renders a view. No DOM.

/// `text` as one quoted word for a POSIX shell.
export function quoted(text) {
  return /^[A-Za-z0-9_\/.,:=@%+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

/// The members of a view that options can express. If any other member differs from the default, the command has the
/// whole view in a file.
const EXPRESSIBLE = ['camera', 'size', 'mode', 'spp', 'noise', 'exposure', 'tonemap'];

/// `scene.store`: the scene's place for the master. `defaults`: the server's default view. `view`: with all members.
/// `output`: the picture's name, with ".png". Returns one line for a shell.
export function command(scene, defaults, view, output) {
  // A word that begins with a dash would be an option.
  const [store, picture] = [scene.store, output].map((name) => (name.startsWith('-') ? `./${name}` : name));
  const render = ['quarry', 'render', quoted(store), '-o', quoted(picture)];
  const { camera } = view;
  const isExpressible = camera.aperture === undefined && Object.keys(view).every((name) => EXPRESSIBLE.includes(name) || JSON.stringify(view[name]) === JSON.stringify(defaults[name]));
  if (!isExpressible) {
    const file = quoted(picture.replace(/\.png$/, '.view.json'));
    return `printf %s ${quoted(JSON.stringify(view))} > ${file} && ${[...render, '--view', file].join(' ')}`;
  }
  const options = {
    size: view.size.join('x'), mode: view.mode, spp: view.spp, noise: view.noise, eye: camera.eye, at: camera.at, up: camera.up, fov: camera.fov, ortho: camera.ortho,
    exposure: view.exposure, tonemap: view.tonemap,
  };
  const words = Object.entries(options).filter(([, value]) => value !== undefined).map(([name, value]) => `--${name}=${value}`);
  return [...render, ...words].join(' ');
}
