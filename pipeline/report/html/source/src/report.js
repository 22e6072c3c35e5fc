// The data that stands in the page.
export const report = JSON.parse(document.getElementById("report-data").textContent);
